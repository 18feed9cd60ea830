"""What hardening gained: AP of a detector before and after on the same renders, and how much of the loss came back.

``recovered = (after - before) / (clean before - before)``, all of them AP@0.5 of one paint: 0 where the camouflage
works as it did, 1 where the hardened detector finds the camouflaged vehicle as well as the first one found the plain.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from .candidates import NORMAL
from .harden_measures import METHOD, UNSEEN, Measures, adaptive_label
from .intervals import Curve, difference_interval
from .results import Estimate
from .scores import difference, estimate
from .study import Entry

HELD_OUT_MEAN = "held-out, mean"
NOTHING_ELSE = Measures(budgets=())
LEAST_LOSS = 0.02  # AP: where a paint took less than that, there is nothing to recover


@dataclass(frozen=True)
class Gain:
    """One paint, or the mean over several.

    Attributes:
        paint: as in tables.
        before, after: AP@0.5 of the two detectors.
        change: after - before; its interval is of the paired difference.
        recovered: share of the loss; None where nothing was lost.
    """

    paint: str
    before: Estimate
    after: Estimate
    change: Estimate
    recovered: Estimate | None


@dataclass(frozen=True)
class Gains:
    """An entry of a study seen by a detector before and after hardening.

    Attributes:
        clean: the vehicle's own paint; its ``change`` is what hardening cost.
        rows: every other paint.
        held_out: the mean over the held-out camouflages, None where there is none.
        methods: the mean over camouflages of held-out methods.
        unseen: the camouflage on a vehicle that hardening never showed.
        adaptive: by budget, the strongest camouflage against the hardened detector.
    """

    entry: Entry
    clean: Gain
    rows: tuple[Gain, ...]
    held_out: Gain | None
    methods: Gain | None = None
    unseen: Gain | None = None
    adaptive: Mapping[int, Gain] = field(default_factory=dict)

    @property
    def failed(self) -> tuple[str, ...]:
        """Adaptive attacks that end above the camouflages which do not know of the hardening: those that failed."""
        limit = math.inf if self.held_out is None else self.held_out.after.ap
        return tuple(gain.paint for gain in self.adaptive.values() if gain.after.ap > limit)


def gains_of(
    entry: Entry, before: str, after: str, held_out: Sequence[str], measures: Measures = NOTHING_ELSE
) -> Gains:
    """Compare two detectors of an entry.

    Args:
        before, after: the detectors' names.
        held_out: the paints whose mean is reported, of those that the entry holds.
        measures: what else is.

    Raises:
        RaucaError: their detections are not kept any more.
    """
    both = (before, after)
    curves = {paint: [entry.recorded.curve(detector, paint) for detector in both] for paint in entry.results.paints}
    clean = curves[NORMAL][0]
    frames = len(entry.results.frames)

    def gain(paint: str, both: Sequence[Curve]) -> Gain:
        before, after = both
        changed, recovered = difference(after - before, frames), _recovered(before, after, clean, frames)
        return Gain(paint, estimate(before, frames), estimate(after, frames), changed, recovered)

    rows = tuple(gain(paint, curves[paint]) for paint in curves if paint != NORMAL)

    def mean(name: str, paints: Sequence[str]) -> Gain | None:
        there = [curves[paint] for paint in paints if paint in curves]
        return gain(name, [np.mean([one[k] for one in there], axis=0) for k in (0, 1)]) if there else None

    of = {gain.paint: gain for gain in rows}
    adaptive = {budget: of[adaptive_label(budget)] for budget in measures.budgets if adaptive_label(budget) in of}
    methods = mean("held-out methods, mean", [METHOD + one for one in measures.methods])
    return Gains(
        entry, gain(NORMAL, curves[NORMAL]), rows, mean(HELD_OUT_MEAN, held_out), methods, of.get(UNSEEN), adaptive
    )


def _recovered(before: Curve, after: Curve, clean: Curve, frames: int) -> Estimate | None:
    """None where there is nothing to recover, with all places or without any one of them."""
    lost = clean - before
    if len(lost) < 3 or (lost < LEAST_LOSS).any():
        return None
    ratio = (after - before) / lost
    return Estimate(float(ratio[0]), *difference_interval(ratio, frames, (-math.inf, math.inf)))
