"""The detections behind results, and the average precision of any part of them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from ..contract import RaucaError
from ..detect import canonical
from ..detect.found import Found
from .average_precision import Ranking, Sample
from .detection_cache import DetectionCache
from .intervals import Curve, Places
from .results import Estimate, Group, Results
from .scores import ap_curve, estimate, places_of


class Recorded:
    """What was detected for some results, by detector, paint and frame; read once from where it is kept.

    Args:
        results: whose detections.
        folder: of ``results.json``, where the paths in it start.
    """

    def __init__(self, results: Results, folder: Path) -> None:
        self._results = results
        self._folder = folder
        self._caches: dict[Path, DetectionCache] = {}
        self._rankings: dict[tuple[str, str], Ranking] = {}

    def found(self, detector: str, paint: str, index: int) -> Found:
        """Detections in the frame at ``index``.

        Raises:
            RaucaError: they are not kept any more.
        """
        image = self._results.images[paint][index]
        cache = self._cache(detector, paint)
        if image.sha256 not in cache:
            raise RaucaError(f"{cache.path}: lacks the detections in {image.path}; evaluate again")
        return cache[image.sha256]

    def sample(self, detector: str, paint: str, index: int) -> Sample:
        """The frame's target with the detections of its class."""
        cars = self.found(detector, paint, index).only(canonical(self._results.settings.category))
        return Sample(np.array(self._results.frames[index].box_xyxy, np.float64), cars.boxes, cars.scores)

    def mean_over(self, detectors: Sequence[str], paint: str) -> Estimate:
        """AP averaged over some of the detectors, with its interval over the results' places.

        Raises:
            RaucaError: as :meth:`found`.
        """
        frames = len(self._results.frames)
        return estimate(np.mean([self.curve(name, paint) for name in detectors], axis=0), frames)

    def mean_of_group(self, detectors: Sequence[str], paint: str, axis: str, group: Group) -> Estimate:
        """The same of the frames that share a value on one of :data:`AXES`, over their places.

        Raises:
            RaucaError: as :meth:`found`.
        """
        rows = self._results.frames
        chosen = np.flatnonzero([getattr(row, axis) == group.value for row in rows])
        places = places_of([rows[index] for index in chosen])
        curves = [
            ap_curve(self._ranking(name, paint).part(chosen), places, group.ap[paint][name]) for name in detectors
        ]
        return estimate(np.mean(curves, axis=0), len(chosen))

    def curve(self, detector: str, paint: str, places: Places | None = None) -> Curve:
        """The results' own AP@0.5, to the bit, then that without each place.

        Args:
            places: to leave out, of the results' frames; the results' own if left out.

        Raises:
            RaucaError: as :meth:`found`.
        """
        ap = self._results.table[paint][detector].ap
        return ap_curve(self._ranking(detector, paint), places or self._places, ap)

    def _ranking(self, detector: str, paint: str) -> Ranking:
        if (detector, paint) not in self._rankings:
            frames = range(len(self._results.frames))
            self._rankings[detector, paint] = Ranking.of([self.sample(detector, paint, index) for index in frames])
        return self._rankings[detector, paint]

    @cached_property
    def _places(self) -> Places:
        return places_of(self._results.frames)

    def _cache(self, detector: str, paint: str) -> DetectionCache:
        results = self._results
        folder = self._folder / results.detections.get(paint, {}).get(detector, "detections")
        if (known := folder / detector) not in self._caches:
            self._caches[known] = DetectionCache(folder, detector, results.detectors[detector], results.settings)
        return self._caches[known]
