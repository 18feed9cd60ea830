"""What the detectors of an evaluation found, read back from the detections that lie beside its results."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from ..contract import RaucaError
from ..detect import canonical
from .average_precision import Sample
from .bootstrap import Ranking
from .detection_cache import DetectionCache, Found
from .results import Estimate
from .scores import Bootstrap, Curve, Draws, estimate
from .study import Entry


class Recorded:
    """The detections of an entry of a study, by detector, paint and frame."""

    def __init__(self, entry: Entry) -> None:
        self._entry = entry
        self._caches: dict[Path, DetectionCache] = {}

    def found(self, detector: str, paint: str, index: int) -> Found:
        """Detections in the frame at ``index``.

        Raises:
            RaucaError: they are not kept any more.
        """
        image = self._entry.results.images[paint][index]
        cache = self._cache(detector, paint)
        if image.sha256 not in cache:
            raise RaucaError(f"{cache.path}: lacks the detections in {image.path}; evaluate again")
        return cache[image.sha256]

    def sample(self, detector: str, paint: str, index: int) -> Sample:
        """The frame's target with the detections of its class."""
        results = self._entry.results
        cars = self.found(detector, paint, index).only(canonical(results.settings.category))
        return Sample(np.array(results.frames[index].box_xyxy, np.float64), cars.boxes, cars.scores)

    def mean_over(self, detectors: Sequence[str], paint: str) -> Estimate:
        """AP averaged over some of the detectors, with its interval by the results' own bootstrap.

        Raises:
            RaucaError: as :meth:`found`.
        """
        return estimate(np.mean([self.curve(name, paint) for name in detectors], axis=0))

    def curve(self, detector: str, paint: str) -> Curve:
        """The results' own AP@0.5, to the bit, then that of each resample of the results' own bootstrap.

        Raises:
            RaucaError: as :meth:`found`.
        """
        results = self._entry.results
        samples = [self.sample(detector, paint, index) for index in range(len(results.frames))]
        return self._draws.curve(Ranking.of(samples), results.table[paint][detector].ap)

    @cached_property
    def _draws(self) -> Draws:
        results = self._entry.results
        return Draws.of(results.frames, Bootstrap(results.resamples, results.seed))

    def _cache(self, detector: str, paint: str) -> DetectionCache:
        results = self._entry.results
        folder = self._entry.folder / results.detections.get(paint, {}).get(detector, "detections")
        if (known := folder / detector) not in self._caches:
            self._caches[known] = DetectionCache(folder, detector, results.detectors[detector], results.settings)
        return self._caches[known]
