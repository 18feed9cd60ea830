"""How sure a figure is: 95 % intervals over places, and over seeds, and what becomes of many claims at once.

Frames of one location share its street, its light and its cameras, so they are no independent draws: a place, with all
of its frames, is what is drawn. A figure is computed once with all places and once without each (the jackknife): all
paints and detectors of a study leave the same places out, so differences are paired by subtracting. The spread of those
figures is the figure's standard error, and Student's t with one degree of freedom fewer than there are places makes an
interval of it. Shares from 0 to 1 are taken to the logit scale first, where their errors are more alike on both sides;
so their intervals never leave 0 to 1.

A camouflage is an optimization, and another seed ends in another one: where there are several, seeds are a second
random effect (:func:`spread`). `rauca bench statistics` measures how often all this covers.

Sources: Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapter 11 (jackknife); Searle, Casella and
McCulloch, Variance Components, 1992, chapter 4 (two crossed effects); Satterthwaite, Biometrics Bulletin 2, 1946
(degrees of freedom); Holm, Scandinavian Journal of Statistics 6, 1979.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

CONFIDENCE = 0.95
SEEDS_NEEDED = 5  # below that, what another seed would bring is hardly known: nothing is called confirmed or refuted
# Part of a frame by which 0 and 1 are kept off infinity on the logit scale, and a figure from a standard error of 0.
# Chosen by coverage at AP .005 to .995: a half covers .98 and more there, none at all has no width.
LEAST_FRAME = 0.25

Curve = NDArray[np.float64]
"""(1 + C,) a figure with all places, then without each of the C; (S, 1 + C) for S seeds."""


@dataclass(frozen=True, eq=False)
class Places:
    """Which frames belong together.

    Attributes:
        kind: ``"locations"``; with a single location ``"views"`` (cameras), and with a single view ``"frames"``.
        of_frame: (F,) place of each frame, counted from 0.
        count: how many places there are; a part of the frames need not show them all.
    """

    kind: str
    of_frame: NDArray[np.int64]
    count: int

    @staticmethod
    def of(locations: Sequence[int], views: Sequence[int]) -> Places:
        """The coarsest places of which there are at least two.

        Args:
            locations, views: of each frame, at least one.
        """
        for kind, values in (("locations", locations), ("views", views)):
            distinct, index = np.unique(np.asarray(values), return_inverse=True)
            if len(distinct) > 1:
                return Places(kind, index.astype(np.int64), len(distinct))
        return Places("frames", np.arange(len(locations)), len(locations))

    @staticmethod
    def in_towns(shown: Sequence[tuple[int, int]]) -> Places:
        """Those of frames of several data sets: a location counts once, whichever vehicle and weather it shows.

        Args:
            shown: town and location of each frame, at least one.
        """
        numbers = {place: number for number, place in enumerate(dict.fromkeys(shown))}
        return Places.of([numbers[place] for place in shown], range(len(shown)))

    def left_out(self) -> NDArray[np.int64]:
        """(1 + C, C): how often each place counts, with all of them, then without each; a single one is kept."""
        if self.count == 1:
            return np.ones((1, 1), np.int64)
        return np.concatenate([np.ones((1, self.count), np.int64), 1 - np.eye(self.count, dtype=np.int64)])


@dataclass(frozen=True)
class Spread:
    """A standard error and the degrees of freedom by which it is known; infinite and 0 where nothing is known."""

    error: float
    freedom: float

    @property
    def reach(self) -> float:
        """How far the 95 % interval goes to either side."""
        if self.freedom <= 0:
            return math.inf
        return float(special.stdtrit(self.freedom, (1 + CONFIDENCE) / 2)) * self.error


def spread(curve: Curve, least: float = 0.0) -> Spread:
    """How much a figure would move in other places, and with other seeds where there are several.

    The variance of the mean over S seeds in C places is (MS_seeds + MS_places - MS_rest) / (S C), of the mean squares
    of the crossed layout of pseudo-values, and never below what seeds or places make by themselves. Its degrees of
    freedom are Satterthwaite's, of the part of the seeds and of what places add to it.

    Args:
        curve: of one seed or several.
        least: the smallest standard error that is believed.
    """
    seeds = np.atleast_2d(curve)
    count, places = len(seeds), seeds.shape[1] - 1
    if places < 2:
        return Spread(math.inf, 0.0)
    without = seeds[:, 1:].mean(0)
    by_place = (places - 1) / places * float(((without - without.mean()) ** 2).sum())
    if count == 1:
        return Spread(max(math.sqrt(by_place), least), places - 1.0)
    by_seed = float(seeds[:, 0].var(ddof=1)) / count
    pseudo = places * seeds[:, :1] - (places - 1) * seeds[:, 1:]
    rest = pseudo - pseudo.mean(0) - pseudo.mean(1, keepdims=True) + pseudo.mean()
    shared = float((rest**2).sum()) / ((count - 1) * (places - 1)) / (count * places)
    variance = max(by_place + by_seed - shared, by_place, by_seed, least**2)
    parts = max(by_place - shared, 0.0) ** 2 / (places - 1) + by_seed**2 / (count - 1)
    freedom = variance**2 / parts if parts > 0 else 0.0
    fewest, most = min(places, count) - 1, places + count - 2
    return Spread(math.sqrt(variance), float(np.clip(freedom, fewest, most)))


def share_interval(curve: Curve, frames: int) -> tuple[float, float]:
    """The 95 % interval of a share, such as AP or recall: inside [0, 1], and never of no width.

    Args:
        curve: of the share, or of the mean of several over the same frames.
        frames: how many there are.
    """
    seeds, margin = np.atleast_2d(curve), LEAST_FRAME / frames
    mean = seeds.mean(0)
    kept = np.clip(mean, margin, 1 - margin)
    slope = float(kept[0] * (1 - kept[0]))  # of the share along its logit
    logits = special.logit(kept)
    # Seeds move about the mean by their own differences, taken to the logit scale by the slope.
    whole = logits + (seeds - mean) / slope
    reach = spread(whole, margin / slope).reach
    low, high = (float(special.expit(logits[0] + sign * reach)) for sign in (-1, 1))
    return min(low, float(mean[0])), max(high, float(mean[0]))


def difference_interval(curve: Curve, frames: int, ends: tuple[float, float] = (-1.0, 1.0)) -> tuple[float, float]:
    """The 95 % interval of a difference of two shares, or of another figure that no transformation suits.

    Args:
        curve: paired, one curve less the other.
        frames: how many there are.
        ends: between which the figure can lie.
    """
    value, reach = float(np.atleast_2d(curve)[:, 0].mean()), spread(curve, LEAST_FRAME / frames).reach
    return max(value - reach, ends[0]), min(value + reach, ends[1])


def chance_of(curve: Curve, frames: int) -> float:
    """How likely a difference at least as large is if there is none: the two-sided p of :func:`difference_interval`."""
    known = spread(curve, LEAST_FRAME / frames)
    if known.freedom <= 0:
        return 1.0
    value = abs(float(np.atleast_2d(curve)[:, 0].mean()))
    return float(2 * special.stdtr(known.freedom, -value / known.error))


def holm(chances: Sequence[float]) -> list[float]:
    """Chances of several claims, corrected: if each is called below 5 %, any is wrongly called in 5 % of families."""
    corrected, largest = [1.0] * len(chances), 0.0
    for rank, index in enumerate(sorted(range(len(chances)), key=lambda index: chances[index])):
        largest = max(largest, min(1.0, (len(chances) - rank) * chances[index]))
        corrected[index] = largest
    return corrected
