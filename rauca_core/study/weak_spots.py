"""Where a detector is weakest: the worst combination of side, distance and weather, the worst tenth of the views, and
the distance from which on it rather misses its target than finds it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from ..contract import RaucaError
from ..contract.schema import Record
from .results import FrameRow

WORST_SHARE = 0.1
HALF = 0.5


@dataclass(frozen=True)
class Cell(Record):
    """The views from one side and distance in one weather.

    Attributes:
        recall: share of them in which the target is found at the deployed score.
        score: mean over them of the best score on the target.
        frames: their ids.
    """

    azimuth_deg: float
    distance_m: float
    weather: str
    recall: float
    score: float
    frames: tuple[str, ...]


@dataclass(frozen=True)
class WorstTenth(Record):
    """The tenth of the views with the lowest scores on the target (at least one view)."""

    score: float
    recall: float
    frames: tuple[str, ...]


@dataclass(frozen=True)
class Range(Record):
    """From which distance on the target is missed more often than found.

    Attributes:
        metres: between the nearest and the farthest distance of the views.
        beyond: it is found more often than not even at the farthest: the range is longer than ``metres``.
        never: it is missed more often than not even at the nearest: the range is shorter than ``metres``.
    """

    metres: float
    beyond: bool
    never: bool


def worst_cell(rows: Sequence[FrameRow], scores: NDArray[np.float64], threshold: float) -> Cell:
    """The cell of the lowest recall, of those the one with the lowest scores.

    Args:
        rows: the frames.
        scores: (F,) best score on the target in each, 0 where it was not seen.
        threshold: lowest score that counts as found.
    """
    cells: dict[tuple[float, float, str], list[int]] = defaultdict(list)
    for index, row in enumerate(_checked(rows, scores)):
        cells[row.azimuth_deg, row.distance_m, row.weather].append(index)

    def described(place: tuple[float, float, str], members: list[int]) -> Cell:
        here = scores[members]
        ids = tuple(rows[index].id for index in members)
        return Cell(*place, float((here >= threshold).mean()), float(here.mean()), ids)

    every = [described(place, members) for place, members in sorted(cells.items())]
    return min(every, key=lambda cell: (cell.recall, cell.score))


def worst_tenth(rows: Sequence[FrameRow], scores: NDArray[np.float64], threshold: float) -> WorstTenth:
    """The tenth of the views with the lowest scores; arguments as of :func:`worst_cell`."""
    _checked(rows, scores)
    lowest = np.argsort(scores, kind="stable")[: max(1, round(WORST_SHARE * len(scores)))]
    here = scores[lowest]
    return WorstTenth(float(here.mean()), float((here >= threshold).mean()), tuple(rows[i].id for i in lowest))


def half_recall_range(rows: Sequence[FrameRow], scores: NDArray[np.float64], threshold: float) -> Range:
    """The distance at which recall falls below one half, were it never to rise with distance.

    Recall by distance is noisy with few views, so it is first fitted by the nearest curve that never rises (isotonic
    regression, weighted by views), and the crossing is interpolated between neighbouring distances.
    """
    _checked(rows, scores)
    distances, which = np.unique([row.distance_m for row in rows], return_inverse=True)
    views = np.bincount(which)
    recall = np.bincount(which, scores >= threshold) / views
    falling = isotonic_regression(recall, weights=views, increasing=False).x
    if falling[0] < HALF:
        return Range(float(distances[0]), beyond=False, never=True)
    if falling[-1] >= HALF:
        return Range(float(distances[-1]), beyond=True, never=False)
    after = int(np.argmax(falling < HALF))
    near, far = falling[after - 1], falling[after]
    share = (near - HALF) / (near - far)
    metres = distances[after - 1] + share * (distances[after] - distances[after - 1])
    return Range(float(metres), beyond=False, never=False)


def _checked(rows: Sequence[FrameRow], scores: NDArray[np.float64]) -> Sequence[FrameRow]:
    if not rows or len(rows) != len(scores):
        raise RaucaError(f"weak spots: {len(rows)} frames with {len(scores)} scores; there must be one score a frame")
    return rows
