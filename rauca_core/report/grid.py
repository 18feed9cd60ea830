"""The grid of pictures: every paint in the same views, with what one detector made of them."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

from PIL import Image, ImageDraw, ImageFont

from ..contract import RaucaError
from ..detect.weights_file import sha256_of
from ..study.detection_cache import Found
from ..study.recorded import Recorded
from ..study.results import FrameRow
from ..study.study import Entry
from .frame_choice import FEW, PLACES, frame_scores, placed_frames, strongest_paint
from .pictures import TILE, frame_picture

PICTURE_THRESHOLD = 0.25
_MARGIN = 26  # pixels for the paint's name above each row of the sheet


@dataclass(frozen=True)
class PictureGrid:
    """JPEG tiles: ``rows[paint][column]``, and a title of two lines per column."""

    titles: list[str]
    rows: dict[str, list[bytes]]

    def sheet(self) -> Image.Image:
        """The grid as one picture, each row under its paint's name."""
        height = TILE + _MARGIN
        sheet = Image.new("RGB", (TILE * len(self.titles), height * len(self.rows)), "white")
        pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(17)
        for index, (paint, tiles) in enumerate(self.rows.items()):
            pen.text((6, index * height + 3), paint, fill="#222222", font=font)
            for column, tile in enumerate(tiles):
                sheet.paste(Image.open(io.BytesIO(tile)), (column * TILE, index * height + _MARGIN))
        return sheet


class FramePicker:
    """The frames that a page shows of some entries, and pictures of them through any of the detectors.

    Raises:
        RaucaError: an image is missing, changed, or was never detected in.
    """

    def __init__(self, entries: Sequence[Entry]) -> None:
        self._entries = entries
        self._paint = strongest_paint(entries[0].results)
        self._places = tuple(PLACES) if len(entries) == 1 else FEW
        self._recorded = [Recorded(entry) for entry in entries]
        self._chosen = [self._choose(entry, recorded) for entry, recorded in zip(entries, self._recorded, strict=True)]

    @property
    def rule(self) -> str:
        """How the frames were chosen, in a sentence."""
        return (
            f"Frames are chosen by rule: sorted by how surely the {self._entries[0].category} is found in "
            f"{self._paint} (highest score at an overlap of 0.5 or more, 0 when missed; mean over all detectors), "
            f"from the camouflage's best to its worst: {', '.join(self._places)}."
        )

    @property
    def columns(self) -> int:
        """How many frames are shown."""
        return len(self._entries) * len(self._places)

    @property
    def paints(self) -> list[str]:
        """Paints that every entry has."""
        first, *others = (entry.results.paints for entry in self._entries)
        return [paint for paint in first if all(paint in other for other in others)]

    def grid(self, detector: str) -> PictureGrid:
        """What ``detector`` saw in the chosen frames, for every paint."""
        titles = [
            self._title(entry, place, entry.results.frames[index])
            for entry, chosen in zip(self._entries, self._chosen, strict=True)
            for place, index in zip(self._places, chosen, strict=True)
        ]
        rows = {
            paint: [
                _tile(entry, recorded.found(detector, paint, index), paint, index)
                for entry, recorded, chosen in zip(self._entries, self._recorded, self._chosen, strict=True)
                for index in chosen
            ]
            for paint in self.paints
        }
        return PictureGrid(titles, rows)

    def _choose(self, entry: Entry, recorded: Recorded) -> list[int]:
        paint = self._paint if self._paint in entry.results.paints else strongest_paint(entry.results)
        return placed_frames(frame_scores(entry.results, recorded, paint), self._places)

    def _title(self, entry: Entry, place: str, row: FrameRow) -> str:
        weathers = f"{entry.weathers}, " if len(self._entries) > 1 else ""
        return f"{weathers}{place}\n{row.weather}, {row.azimuth_deg:.0f}°, {row.distance_m:g} m"


def _tile(entry: Entry, found: Found, paint: str, index: int) -> bytes:
    row, shown = entry.results.frames[index], entry.results.images[paint][index]
    path = entry.folder / shown.path
    if not path.is_file() or sha256_of(path) != shown.sha256:
        raise RaucaError(f"{path}: missing or changed since it was evaluated; evaluate again")
    return frame_picture(path, row.box_xyxy, found, entry.category, PICTURE_THRESHOLD)
