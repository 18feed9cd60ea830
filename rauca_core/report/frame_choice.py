"""Which frames stand for all in the report's pictures: chosen by a rule, not by eye."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..study.average_precision import IOU_THRESHOLD, Sample
from ..study.bootstrap import box_overlaps
from ..study.recorded import Recorded
from ..study.results import MEAN, Results
from .tables import is_normal, is_random

PLACES = {"best": 0.0, "lower quartile": 0.25, "median": 0.5, "upper quartile": 0.75, "worst": 1.0}
FEW = ("best", "median", "worst")


def strongest_paint(results: Results) -> str:
    """The camouflage with the lowest AP, mean over detectors; without any, random paint, else the vehicle's own."""
    paints = [paint for paint in results.paints if not is_normal(paint)]
    rivals = [paint for paint in paints if not is_random(paint)] or paints or list(results.paints)
    return min(rivals, key=lambda paint: results.table[paint][MEAN].ap)


def found_score(sample: Sample) -> float:
    """The highest score of a detection of the target's class that overlaps it by half; 0 when it is missed."""
    right = box_overlaps(sample.boxes, sample.truth) >= IOU_THRESHOLD
    return float(sample.scores[right].max(initial=0.0))


def frame_scores(results: Results, recorded: Recorded, paint: str) -> NDArray[np.float64]:
    """(F,) how surely each frame's target is found in ``paint``: the mean over detectors of :func:`found_score`."""
    scores = [
        [found_score(recorded.sample(name, paint, index)) for name in results.detectors]
        for index in range(len(results.frames))
    ]
    return np.array(scores, np.float64).mean(1)


def placed_frames(scores: NDArray[np.float64], places: Sequence[str]) -> list[int]:
    """The frames at some of :data:`PLACES` when sorted by score, lowest first; equal ones stay in plan order."""
    order = np.argsort(scores, kind="stable")
    return [int(order[round(PLACES[place] * (len(order) - 1))]) for place in places]
