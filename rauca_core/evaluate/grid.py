"""The grid of pictures: every paint in the same views, with what one detector made of them."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from ..contract import RaucaError
from ..detect.weights_file import sha256_of
from .detection_cache import DetectionCache
from .frame_choice import chosen_frames
from .pictures import TILE, frame_picture
from .results import FrameRow, Results

PICTURE_THRESHOLD = 0.25
_MARGIN = 26  # pixels for the paint's name above each row of the sheet


@dataclass(frozen=True)
class PictureGrid:
    """JPEG tiles: ``rows[paint][column]``, with a title per column."""

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


def picture_grid(results: Results, folder: Path, detector: str) -> PictureGrid:
    """Draw ``detector``'s detections in a few frames that show the variety, for every paint.

    Raises:
        RaucaError: an image in ``folder`` is missing or changed since it was evaluated.
    """
    cache = DetectionCache(folder / "detections", detector, results.detectors[detector], results.settings)
    chosen = chosen_frames(results.frames)
    rows: dict[str, list[bytes]] = {}
    for paint in results.paints:
        rows[paint] = [_tile(results, folder, cache, paint, index) for index in chosen]
    return PictureGrid([_caption(results.frames[index]) for index in chosen], rows)


def _tile(results: Results, folder: Path, cache: DetectionCache, paint: str, index: int) -> bytes:
    row, shown = results.frames[index], results.images[paint][index]
    path = folder / shown.path
    if not path.is_file() or sha256_of(path) != shown.sha256 or shown.sha256 not in cache:
        raise RaucaError(f"{path}: missing or changed since it was evaluated; evaluate again")
    return frame_picture(path, row.box_xyxy, cache[shown.sha256], results.settings.category, PICTURE_THRESHOLD)


def _caption(row: FrameRow) -> str:
    return f"{row.weather}, {row.azimuth_deg:.0f}°, {row.distance_m:.0f} m"
