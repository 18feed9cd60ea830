"""What hardening gained: AP of a detector before and after on the same renders, and how much of the loss came back.

``recovered = (after - before) / (clean before - before)``, all of them AP@0.5 of one paint: 0 where the camouflage
works as it did, 1 where the hardened detector finds the camouflaged vehicle as well as the first one found the plain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .bootstrap import Ranking, interval
from .contestants import NORMAL
from .recorded import Recorded
from .results import Estimate
from .scores import clusters_of
from .study import Entry

LEAST_LOSS = 0.02  # AP: where a paint took less than that, there is nothing to recover
KNOWN = 0.5  # share of resamples that must show a loss for an interval of the recovered share
Curve = NDArray[np.float64]  # AP@0.5 (1 + R,): of the frames as they are, then of R resamples


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
        weathers, vehicle, category: of the entry.
        frames, draws: how many frames, and what the bootstrap draws, e.g. ``"8 locations"``.
        clean: the vehicle's own paint; its ``change`` is what hardening cost.
        rows: every other paint.
        held_out: the mean over the held-out camouflages.
    """

    weathers: str
    vehicle: str
    category: str
    frames: int
    draws: str
    clean: Gain
    rows: tuple[Gain, ...]
    held_out: Gain

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


def gains_of(entry: Entry, before: str, after: str, held_out: Sequence[str]) -> Gains:
    """Compare two detectors of an entry.

    Args:
        before, after: the detectors' names.
        held_out: the paints whose mean is reported.

    Raises:
        RaucaError: their detections are not kept any more.
    """
    curves = _curves(entry, (before, after))
    clean = curves[NORMAL][0]
    rows = tuple(_gain(paint, curves[paint], clean) for paint in curves if paint != NORMAL)
    mean = [np.mean([curves[paint][k] for paint in held_out], axis=0) for k in (0, 1)]
    results = entry.results
    return Gains(
        weathers=entry.weathers,
        vehicle=entry.vehicle,
        category=entry.category,
        frames=len(results.frames),
        draws=f"{results.cluster_count} {results.clusters}",
        clean=_gain(NORMAL, curves[NORMAL], clean),
        rows=rows,
        held_out=_gain("held-out, mean", mean, clean),
    )


def _curves(entry: Entry, detectors: tuple[str, str]) -> Mapping[str, list[Curve]]:
    """Per paint, of each detector; all share the resamples."""
    results, recorded = entry.results, Recorded(entry)
    clusters = clusters_of(results.frames)
    drawn = clusters.resample(results.resamples, results.seed)
    counts = np.concatenate([np.ones_like(drawn[:1]), drawn])

    def curve(detector: str, paint: str) -> Curve:
        samples = [recorded.sample(detector, paint, index) for index in range(len(results.frames))]
        values = Ranking.of(samples).average_precision(counts, clusters.of_frame)
        values[0] = results.table[paint][detector].ap  # the published number, to the bit
        return values

    return {paint: [curve(detector, paint) for detector in detectors] for paint in results.paints}


def _gain(paint: str, curves: Sequence[Curve], clean: Curve) -> Gain:
    before, after = curves
    return Gain(paint, _estimate(before), _estimate(after), _estimate(after - before), _recovered(before, after, clean))


def _recovered(before: Curve, after: Curve, clean: Curve) -> Estimate | None:
    lost = clean - before
    known = lost >= LEAST_LOSS
    if not known[0] or known[1:].mean() < KNOWN:
        return None
    shares = (after - before)[known] / lost[known]
    return Estimate(float(shares[0]), *interval(shares[1:]))


def _estimate(values: Curve) -> Estimate:
    return Estimate(float(values[0]), *interval(values[1:]))
