"""The views that a detector does worst in, chosen by their scores and not by eye, as grids of pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..study.candidates import NORMAL
from ..study.pooled import Pool
from ..study.study import Entry
from .assessment_tables import where
from .frames import Grid, Picture, frame_tile

MOST = 5  # pictures in a row


@dataclass(frozen=True)
class WorstViews:
    """The worst views in a paint, with the vehicle's own above it.

    Attributes:
        many, of: how many such views there are, and views in all.
        grid: pictures of the first few; None where there are none.
    """

    paint: str
    many: int
    of: int
    grid: Grid | None


class ViewPicker:
    """The worst views of a detector in some entries, and pictures of what it sees there.

    Args:
        pool: the detector's findings in the entries, in their order.
        threshold: score from which on a vehicle counts as found.
    """

    def __init__(self, entries: Sequence[Entry], pool: Pool, detector: str, threshold: float) -> None:
        self._places = [(entry, index) for entry in entries for index in range(len(entry.results.frames))]
        self._pool, self._detector, self._threshold = pool, detector, threshold
        self._plain = pool.scores(NORMAL)

    def missed_plain(self) -> WorstViews:
        """Views in which not even the plain vehicle is found, lowest scores first.

        Raises:
            RaucaError: an image is missing, changed, or was never detected in; so do the others.
        """
        missed = np.flatnonzero(self._plain < self._threshold)
        chosen = missed[np.argsort(self._plain[missed], kind="stable")]
        return self._views(NORMAL, chosen)

    def lost_in(self, paint: str) -> WorstViews:
        """Views in which the plain vehicle is found, but not in a paint: lowest scores first, of equal ones those in
        which the plain vehicle is found most surely.
        """
        scores = self._pool.scores(paint)
        lost = np.flatnonzero((self._plain >= self._threshold) & (scores < self._threshold))
        return self._views(paint, lost[np.lexsort((-self._plain[lost], scores[lost]))])

    def _views(self, paint: str, chosen: NDArray[np.int64]) -> WorstViews:
        shown = chosen[:MOST].tolist()
        scores = {name: self._pool.scores(name) for name in dict.fromkeys((NORMAL, paint))}
        titles = [
            self._title(number, {name: float(found[number]) for name, found in scores.items()}) for number in shown
        ]
        rows = {name: [self._picture(number, name, paint) for number in shown] for name in scores}
        return WorstViews(paint, len(chosen), len(self._places), Grid(titles, rows) if shown else None)

    def _title(self, number: int, scores: dict[str, float]) -> str:
        entry, index = self._places[number]
        row = entry.results.frames[index]
        found = ", ".join(f"{name} {score:.2f}" for name, score in scores.items())
        return f"{entry.vehicle}, {where(row.azimuth_deg, row.distance_m, row.weather)}\nscore in {found}"

    def _picture(self, number: int, paint: str, among: str) -> Picture:
        entry, index = self._places[number]
        found = entry.recorded.found(self._detector, paint, index)
        of = "missed in plain paint" if among == NORMAL else f"lost in {among}"
        alt = f"{of}: view {self._pool.rows[number].id} in {paint}, seen by {self._detector}"
        return Picture(frame_tile(entry, found, paint, index, self._threshold), alt)
