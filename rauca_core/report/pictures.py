"""Pictures of the report: frames with boxes drawn in, UV maps with the atlas's outline."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ..contract import Camouflage, Dataset, load_camouflage
from ..detect import canonical
from ..runtime.images import read_image
from ..study.average_precision import IOU_THRESHOLD
from ..study.bootstrap import box_overlaps
from ..study.detection_cache import Found
from ..study.study import Entry

TILE = 300  # pixels across a picture of the grid
MAP = 512  # and a UV map
TRUTH, CORRECT, WRONG, OTHER = "#ffffff", "#4cc2ff", "#ff6a3d", "#ffd84d"  # told apart with any color vision
_CASING = "#00000090"  # keeps the thin true box visible on white cars


def frame_picture(path: Path, truth: tuple[float, ...], found: Found, category: str, threshold: float) -> bytes:
    """The part of a frame around its target as JPEG, with the true box (thin, white) and detections with their score.

    Those that score ``threshold`` or more are drawn. Blue finds the target, red is the target's class elsewhere,
    yellow is another class.
    """
    pixels = read_image(path)
    window = _window(np.array(truth), pixels.shape[1], pixels.shape[0])
    left, top, side = window
    picture = Image.fromarray(pixels).convert("RGB")
    picture = picture.resize((TILE, TILE), Image.Resampling.LANCZOS, box=(left, top, left + side, top + side))
    pen = ImageDraw.Draw(picture, "RGBA")
    _thin(pen, _in_window(np.array(truth), window))
    overlaps = box_overlaps(found.boxes, np.array(truth))
    labels = _Labels(pen)
    for i in range(len(found.scores)):  # best first: it takes the best place for its label
        box = _in_window(found.boxes[i], window)
        if found.scores[i] >= threshold and (box[2:] > 0).all() and (box[:2] < TILE).all():
            right = overlaps[i] >= IOU_THRESHOLD
            color = OTHER if found.names[i] != canonical(category) else CORRECT if right else WRONG
            labels.add(box, f"{found.names[i]} {found.scores[i]:.2f}", color)
    labels.draw()
    return _jpeg(picture)


class _Labels:
    """Detections of a picture: boxes first, then their labels, which keep clear of each other where there is room."""

    def __init__(self, pen: ImageDraw.ImageDraw) -> None:
        self._pen = pen
        self._font = ImageFont.load_default(17)
        self._placed: list[tuple[int, int, int, int, str, str]] = []

    def add(self, box: NDArray[np.float64], text: str, color: str) -> None:
        """Outline the box; its label goes above it, below it, or to the next free height."""
        left, top, right, bottom = box.tolist()
        self._pen.rectangle((left, top, max(right - 1, left), max(bottom - 1, top)), outline=color, width=2)
        _, _, width, height = (int(v) for v in self._font.getbbox(text))
        width, height = width + 6, height + 4
        x = int(min(max(left, 0), TILE - width))
        wanted = [top - height, bottom, top, *range(0, TILE - height, height)]
        heights = [int(min(max(y, 0), TILE - height)) for y in wanted]
        y = next((y for y in heights if self._free(x, y, width, height)), heights[0])
        self._placed.append((x, y, x + width, y + height, text, color))

    def draw(self) -> None:
        for left, top, right, bottom, text, color in reversed(self._placed):
            self._pen.rectangle((left, top, right, bottom), fill=color)
            self._pen.text((left + 3, top + 1), text, fill="#101418", font=self._font)

    def _free(self, x: int, y: int, width: int, height: int) -> bool:
        return all(
            x >= right or x + width <= left or y >= bottom or y + height <= top
            for left, top, right, bottom, _, _ in self._placed
        )


def _window(truth: NDArray[np.float64], width: int, height: int) -> tuple[float, float, float]:
    """Left, top and side of a square inside the image, half as large again as the target and centered on it; pixels."""
    side = min(float(width), float(height), max(1.5 * (truth[2:] - truth[:2]).max(), 32.0))
    left = np.clip((truth[0] + truth[2] - side) / 2, 0, width - side)
    top = np.clip((truth[1] + truth[3] - side) / 2, 0, height - side)
    return float(left), float(top), side


def _in_window(box: NDArray[np.float64], window: tuple[float, float, float]) -> NDArray[np.float64]:
    left, top, side = window
    return (box - np.array([left, top, left, top])) * TILE / side


def map_picture(uv_map: Path, paint_mask: NDArray[np.uint8] | None) -> bytes:
    """A UV map as JPEG, dimmed outside the paintable charts and with their outline where the mask is known."""
    picture = Image.fromarray(read_image(uv_map)).convert("RGB").resize((MAP, MAP), Image.Resampling.LANCZOS)
    if paint_mask is None:
        return _jpeg(picture)
    inside = np.asarray(Image.fromarray(paint_mask).resize((MAP, MAP), Image.Resampling.BILINEAR)) > 127
    pixels = np.asarray(picture).astype(np.float32)
    pixels[~inside] = 0.2 * pixels[~inside] + 0.8 * 245
    edge = np.zeros_like(inside)
    edge[1:-1, 1:-1] = inside[1:-1, 1:-1] & ~(
        inside[:-2, 1:-1] & inside[2:, 1:-1] & inside[1:-1, :-2] & inside[1:-1, 2:]
    )
    pixels[edge] = (20, 24, 30)
    return _jpeg(Image.fromarray(pixels.astype(np.uint8)))


def maps_of(entries: Sequence[Entry]) -> list[tuple[Camouflage, bytes]]:
    """Every camouflage once, with its UV map as JPEG, its paintable part outlined where the study names its views.

    Raises:
        RaucaError: a camouflage that is missing, damaged, or made for another UV atlas than the views' vehicle.
    """
    found = {path.resolve(): (path, entry) for entry in entries for path in entry.camouflages.values()}
    return [_map(path, entry) for path, entry in found.values()]


def _map(path: Path, entry: Entry) -> tuple[Camouflage, bytes]:
    camouflage, uv_map = load_camouflage(path)
    if entry.views is None:
        return camouflage, map_picture(uv_map, None)
    views = Dataset(entry.views)
    camouflage.check_fits(views.plan.atlas_id, str(path))
    return camouflage, map_picture(uv_map, read_image(views.vehicle_folder / "paint_mask.png"))


def _thin(pen: ImageDraw.ImageDraw, box: NDArray[np.float64]) -> None:
    left, top, right, bottom = (round(v) for v in box.tolist())
    pen.rectangle((left - 1, top - 1, right + 1, bottom + 1), outline=_CASING, width=3)
    pen.rectangle((left, top, right, bottom), outline=TRUTH, width=1)


def _jpeg(picture: Image.Image) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, "JPEG", quality=80, optimize=True)
    return stream.getvalue()
