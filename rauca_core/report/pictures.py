"""Pictures of the report: frames with boxes drawn in, UV maps with the atlas's outline."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ..contract import Camouflage, Dataset, load_camouflage
from ..detect import canonical
from ..detect.found import Found
from ..runtime.images import read_image
from ..study.average_precision import IOU_THRESHOLD, box_overlaps
from ..study.study import Entry

TILE = 300  # pixels across a picture of the grid
MAP = 512  # and a UV map
TRUTH, CORRECT, WRONG, OTHER = "#ffffff", "#4cc2ff", "#ff6a3d", "#ffd84d"  # told apart with any color vision
_FONT = ImageFont.load_default(17)
_MARGIN = 26  # pixels for the paint's name above each row of a sheet
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
    thin(pen, _in_window(np.array(truth), window))
    overlaps = box_overlaps(found.boxes, np.array(truth))
    for i in reversed(range(len(found.scores))):  # the best comes last: nothing covers its label
        box = _in_window(found.boxes[i], window)
        if found.scores[i] >= threshold and (box[2:] > 0).all() and (box[:2] < TILE).all():
            right = overlaps[i] >= IOU_THRESHOLD
            color = OTHER if found.names[i] != canonical(category) else CORRECT if right else WRONG
            label(pen, box, f"{found.names[i]} {found.scores[i]:.2f}", color)
    return as_jpeg(picture)


def label(pen: ImageDraw.ImageDraw, box: NDArray[np.float64], text: str, color: str, side: int = TILE) -> None:
    """Outline a box, with its label above it or, where that is outside the picture, at its upper edge."""
    left, top, right, bottom = box.tolist()
    pen.rectangle((left, top, max(right - 1, left), max(bottom - 1, top)), outline=color, width=2)
    _, _, width, height = (int(v) + 4 for v in _FONT.getbbox(text))
    x, y = min(max(left, 0), side - width), min(max(top - height, 0), side - height)
    pen.rectangle((x, y, x + width, y + height), fill=color)
    pen.text((x + 2, y + 1), text, fill="#101418", font=_FONT)


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
        return as_jpeg(picture)
    inside = np.asarray(Image.fromarray(paint_mask).resize((MAP, MAP), Image.Resampling.BILINEAR)) > 127
    pixels = np.asarray(picture).astype(np.float32)
    pixels[~inside] = 0.2 * pixels[~inside] + 0.8 * 245
    core = cv2.erode(inside.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))) > 0
    pixels[inside & ~core] = (20, 24, 30)
    return as_jpeg(Image.fromarray(pixels.astype(np.uint8)))


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


def sheet_of(rows: Mapping[str, Sequence[bytes]]) -> Image.Image:
    """Tiles as one picture, each row under its paint's name."""
    height, columns = TILE + _MARGIN, max(map(len, rows.values()))
    sheet = Image.new("RGB", (TILE * columns, height * len(rows)), "white")
    pen = ImageDraw.Draw(sheet)
    for index, (paint, tiles) in enumerate(rows.items()):
        pen.text((6, index * height + 3), paint, fill="#222222", font=_FONT)
        for column, tile in enumerate(tiles):
            sheet.paste(Image.open(io.BytesIO(tile)), (column * TILE, index * height + _MARGIN))
    return sheet


def thin(pen: ImageDraw.ImageDraw, box: NDArray[np.float64]) -> None:
    left, top, right, bottom = (round(v) for v in box.tolist())
    pen.rectangle((left - 1, top - 1, right + 1, bottom + 1), outline=_CASING, width=3)
    pen.rectangle((left, top, right, bottom), outline=TRUTH, width=1)


def as_jpeg(picture: Image.Image) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, "JPEG", quality=80, optimize=True)
    return stream.getvalue()
