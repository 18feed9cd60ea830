"""The frames that stand for all in a report, chosen by a rule and not by eye, and grids of pictures of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

import numpy as np
from numpy.typing import NDArray

from ..contract import RaucaError
from ..contract.files import file_digest
from ..detect.found import Found
from ..study.average_precision import best_score
from ..study.parts import leading
from ..study.study import Entry
from .pictures import frame_picture
from .table import is_normal, is_random

PLACES = {"best": 0.0, "lower quartile": 0.25, "median": 0.5, "upper quartile": 0.75, "worst": 1.0}
FEW = ("best", "median", "worst")
PICTURE_THRESHOLD = 0.25


def strongest_paint(entry: Entry) -> str:
    """The camouflage with the lowest AP; without any, random paint, else the vehicle's own.

    The mean is over the detectors farthest from the attacks (`study/parts.py`).
    """
    results, detectors = entry.results, leading(entry.parts)[1]
    paints = [paint for paint in results.paints if not is_normal(paint)]
    rivals = [paint for paint in paints if not is_random(paint)] or paints or list(results.paints)
    return min(rivals, key=lambda paint: fmean(results.table[paint][name].ap for name in detectors))


def frame_scores(entry: Entry, paint: str) -> NDArray[np.float64]:
    """(F,) how surely each frame's target is found in ``paint``: the mean over detectors of its best score."""
    scores = [
        [best_score(entry.recorded.sample(name, paint, index)) for name in entry.results.detectors]
        for index in range(len(entry.results.frames))
    ]
    return np.array(scores, np.float64).mean(1)


def placed_frames(scores: NDArray[np.float64], places: Sequence[str]) -> list[int]:
    """The frames at some of :data:`PLACES` when sorted by score, lowest first; equal ones stay in plan order."""
    order = np.argsort(scores, kind="stable")
    return [int(order[round(PLACES[place] * (len(order) - 1))]) for place in places]


def reading_of(category: str, threshold: float) -> str:
    """How to read pictures of frames."""
    return (
        f"Cut out around the vehicle. Thin white: the true box. Detections that score {threshold:g} or more: blue "
        f"finds the {category}, red reports one elsewhere, yellow takes it, or something else, for another thing."
    )


@dataclass(frozen=True)
class Picture:
    """A JPEG; ``alt`` says what it shows."""

    jpeg: bytes
    alt: str


@dataclass(frozen=True)
class Grid:
    """Rows of pictures under titles of one line or two; None leaves a hole."""

    titles: Sequence[str]
    rows: Mapping[str, Sequence[Picture | None]]


class FramePicker:
    """The frames that a page shows of some entries, and pictures of them through any of the detectors.

    Raises:
        RaucaError: an image is missing, changed, or was never detected in.
    """

    def __init__(self, entries: Sequence[Entry]) -> None:
        self._entries = entries
        self._paint = strongest_paint(entries[0])
        self._places = tuple(PLACES) if len(entries) == 1 else FEW
        self._frames = [frame for entry in entries for frame in self._choose(entry)]

    @property
    def rule(self) -> str:
        """How the frames were chosen, in a sentence."""
        return (
            f"Frames are chosen by rule: sorted by how surely the {self._entries[0].category} is found in "
            f"{self._paint} (highest score at an overlap of 0.5 or more, 0 when missed; mean over all detectors), "
            f"from the camouflage's best to its worst: {', '.join(self._places)}."
        )

    @property
    def reading(self) -> str:
        """How to read the pictures, after how they were chosen."""
        return f"{self.rule} {reading_of(self._entries[0].category, PICTURE_THRESHOLD)}"

    @property
    def paints(self) -> list[str]:
        """Paints that every entry has."""
        first, *others = (entry.results.paints for entry in self._entries)
        return [paint for paint in first if all(paint in other for other in others)]

    @property
    def pictures(self) -> int:
        """How many a grid has."""
        return len(self._frames) * len(self.paints)

    def grid(self, detector: str, when: str = "") -> Grid:
        """What a detector saw in the chosen frames, a row per paint; ``when`` is added to pictures' descriptions."""
        titles = [self._title(entry, place, index) for entry, place, index in self._frames]
        rows = {
            paint: [
                Picture(
                    frame_tile(entry, entry.recorded.found(detector, paint, index), paint, index),
                    f"{paint}, {title}, seen by {detector}{when}".replace("\n", ", "),
                )
                for title, (entry, _, index) in zip(titles, self._frames, strict=True)
            ]
            for paint in self.paints
        }
        return Grid(titles, rows)

    def _choose(self, entry: Entry) -> list[tuple[Entry, str, int]]:
        paint = self._paint if self._paint in entry.results.paints else strongest_paint(entry)
        chosen = placed_frames(frame_scores(entry, paint), self._places)
        return [(entry, place, index) for place, index in zip(self._places, chosen, strict=True)]

    def _title(self, entry: Entry, place: str, index: int) -> str:
        row = entry.results.frames[index]
        weathers = f"{entry.weathers}, " if len(self._entries) > 1 else ""
        return f"{weathers}{place}\n{row.weather}, {row.azimuth_deg:.0f}°, {row.distance_m:g} m"


def frame_tile(entry: Entry, found: Found, paint: str, index: int, threshold: float = PICTURE_THRESHOLD) -> bytes:
    """A frame of an entry with what was found in it from ``threshold`` on, as JPEG.

    Raises:
        RaucaError: the image is missing, or has changed since.
    """
    path = image_path(entry, paint, index)
    return frame_picture(path, entry.results.frames[index].box_xyxy, found, entry.category, threshold)


def image_path(entry: Entry, paint: str, index: int) -> Path:
    """The image of an entry's frame in a paint.

    Raises:
        RaucaError: it is missing, or has changed since it was evaluated.
    """
    shown = entry.results.images[paint][index]
    path = entry.folder / shown.path
    if not path.is_file() or file_digest(path) != shown.sha256:
        raise RaucaError(f"{path}: missing or changed since it was evaluated; evaluate again")
    return path
