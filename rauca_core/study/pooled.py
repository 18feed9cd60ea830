"""Entries of a study taken together: all vehicles, views and weathers as one sample, places counted once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..detect import canonical
from .assessment import Score
from .average_precision import Ranking, Sample, best_score
from .intervals import Curve, Places, share_interval
from .mistakes import Mistakes, mistakes_in
from .scores import ap_curve
from .study import Entry


class Pool:
    """One detector's findings in several entries that hold the same paints.

    Frames of one place stand together, whichever vehicle and weather they show: entries of one town have the same
    places, which `town_of` tells.

    Attributes:
        rows: every frame, in the order of the entries, under an id with its vehicle and weathers.
        paints: that all entries have.
    """

    def __init__(self, entries: Sequence[Entry], detector: str, town_of: Callable[[Entry], int]) -> None:
        self._entries = tuple(entries)
        self._detector = detector
        self._towns = [town_of(entry) for entry in entries]
        self.rows = tuple(
            replace(row, id=f"{entry.vehicle}/{entry.weathers}/{row.id}")
            for entry in entries
            for row in entry.results.frames
        )
        self._curves: dict[str, Curve] = {}
        shared = set.intersection(*(set(entry.results.paints) for entry in entries))
        self.paints = tuple(paint for paint in entries[0].results.paints if paint in shared)

    def samples(self, paint: str) -> list[Sample]:
        """The target and the detections of its class, frame by frame."""
        return [
            entry.recorded.sample(self._detector, paint, index)
            for entry in self._entries
            for index in range(len(entry.results.frames))
        ]

    def scores(self, paint: str) -> NDArray[np.float64]:
        """(F,) best score of a detection that finds the target, 0 where there is none."""
        return np.array([best_score(sample) for sample in self.samples(paint)])

    def score(self, paints: Sequence[str], threshold: float) -> Score:
        """AP@0.5 and recall at a deployed score, the mean over some paints; its interval is over places."""
        curve = self.curve(paints)
        recall = float(np.mean([(self.scores(paint) >= threshold).mean() for paint in paints]))
        return Score(float(curve[0]), *share_interval(curve, len(self.rows)), recall, len(self.rows) * len(paints))

    def curve(self, paints: Sequence[str]) -> Curve:
        """(1 + C,) AP@0.5 with all places, then without each; the mean over some paints."""
        for paint in set(paints) - set(self._curves):
            self._curves[paint] = ap_curve(Ranking.of(self.samples(paint)), self.places)
        return np.mean([self._curves[paint] for paint in paints], axis=0, dtype=np.float64)

    def mistakes(self, paint: str, threshold: float) -> Mistakes:
        """What is wrong at a deployed score, over all frames."""
        every = (
            mistakes_in(
                entry.recorded.found(self._detector, paint, index),
                np.array(row.box_xyxy, np.float64),
                canonical(entry.results.settings.category),
                threshold,
            )
            for entry in self._entries
            for index, row in enumerate(entry.results.frames)
        )
        return sum(every, Mistakes())

    @cached_property
    def places(self) -> Places:
        """The places of all frames, whichever entry shows them."""
        shown = [
            (town, row.location)
            for town, entry in zip(self._towns, self._entries, strict=True)
            for row in entry.results.frames
        ]
        return Places.in_towns(shown)
