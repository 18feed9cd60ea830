"""Which frames stand for all in the report's pictures: chosen by a rule, not by eye."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..detect import canonical
from .average_precision import IOU_THRESHOLD
from .bootstrap import box_overlaps
from .detection_cache import DetectionCache, Found
from .results import MEAN, FrameRow, Results
from .tables import is_normal

PLACES = {"best": 0.0, "lower quartile": 0.25, "median": 0.5, "upper quartile": 0.75, "worst": 1.0}
FEW = ("best", "median", "worst")


def strongest_paint(results: Results) -> str:
    """The paint other than normal with the lowest AP, mean over detectors; normal where it is alone."""
    rivals = [paint for paint in results.paints if not is_normal(paint)] or list(results.paints)
    return min(rivals, key=lambda paint: results.table[paint][MEAN].ap)


def caches_of(results: Results, folder: Path) -> dict[str, DetectionCache]:
    """Every detector's detections, as they lie beside the results in ``folder``."""
    return {
        name: DetectionCache(folder / "detections", name, fingerprint, results.settings)
        for name, fingerprint in results.detectors.items()
    }


def found_score(row: FrameRow, found: Found, category: str) -> float:
    """The highest score of a detection of the target's class that overlaps it by half; 0 when it is missed."""
    cars = found.only(canonical(category))
    right = box_overlaps(cars.boxes, np.array(row.box_xyxy, np.float64)) >= IOU_THRESHOLD
    return float(cars.scores[right].max(initial=0.0))


def frame_scores(results: Results, caches: dict[str, DetectionCache], paint: str) -> NDArray[np.float64]:
    """(F,) how surely each frame's target is found in ``paint``: the mean over detectors of :func:`found_score`.

    Raises:
        KeyError: an image was never detected in.
    """
    scores = [
        [found_score(row, cache[shown.sha256], results.settings.category) for cache in caches.values()]
        for row, shown in zip(results.frames, results.images[paint], strict=True)
    ]
    return np.array(scores, np.float64).mean(1)


def placed_frames(scores: NDArray[np.float64], places: Sequence[str]) -> list[int]:
    """The frames at some of :data:`PLACES` when sorted by score, lowest first; equal ones stay in plan order."""
    order = np.argsort(scores, kind="stable")
    return [int(order[round(PLACES[place] * (len(order) - 1))]) for place in places]
