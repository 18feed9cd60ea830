"""Pictures of the report: frames with boxes drawn in, UV maps with the atlas's outline."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ..images import read_image
from .average_precision import IOU_THRESHOLD
from .bootstrap import box_overlaps
from .detection_cache import Found

TILE = 320  # pixels across a picture of the grid
MAP = 640  # and a UV map
TRUTH, CORRECT, WRONG, OTHER = "#ffffff", "#2ecc71", "#ff5a4f", "#ffb300"


def frame_picture(path: Path, truth: tuple[float, ...], found: Found, category: str, threshold: float) -> bytes:
    """A frame as JPEG, with its ground truth (white, dashed) and every detection that scores ``threshold`` or more.

    Green finds the target, red is the target's class elsewhere, amber is another class.
    """
    pixels = read_image(path)
    scale = TILE / pixels.shape[1]
    height = max(1, round(pixels.shape[0] * scale))
    picture = Image.fromarray(pixels).convert("RGB").resize((TILE, height), Image.Resampling.LANCZOS)
    pen = ImageDraw.Draw(picture)
    _dashed(pen, np.array(truth) * scale)
    overlaps = box_overlaps(found.boxes, np.array(truth))
    shown = [i for i in range(len(found.scores)) if found.scores[i] >= threshold]
    for i in reversed(shown):  # best last, on top
        right = overlaps[i] >= IOU_THRESHOLD
        colour = OTHER if found.names[i] != category else CORRECT if right else WRONG
        _labelled(pen, found.boxes[i] * scale, f"{found.names[i]} {found.scores[i]:.2f}", colour, picture.size)
    return _encode(picture, "JPEG")


def map_picture(uv_map: Path, paint_mask: NDArray[np.uint8]) -> bytes:
    """A UV map as PNG, dimmed outside the paintable charts and with their outline."""
    picture = Image.open(uv_map).convert("RGB").resize((MAP, MAP), Image.Resampling.LANCZOS)
    inside = np.asarray(Image.fromarray(paint_mask).resize((MAP, MAP), Image.Resampling.BILINEAR)) > 127
    pixels = np.asarray(picture).astype(np.float32)
    pixels[~inside] = 0.2 * pixels[~inside] + 0.8 * 245
    edge = np.zeros_like(inside)
    edge[1:-1, 1:-1] = inside[1:-1, 1:-1] & ~(
        inside[:-2, 1:-1] & inside[2:, 1:-1] & inside[1:-1, :-2] & inside[1:-1, 2:]
    )
    pixels[edge] = (20, 24, 30)
    return _encode(Image.fromarray(pixels.astype(np.uint8)), "PNG")


def _dashed(pen: ImageDraw.ImageDraw, box: NDArray[np.float64]) -> None:
    left, top, right, bottom = box.tolist()
    dash = 5
    for start in np.arange(left, right, 2 * dash):
        for y in (top, bottom):
            pen.line((start, y, min(start + dash, right), y), TRUTH, 1)
    for start in np.arange(top, bottom, 2 * dash):
        for x in (left, right):
            pen.line((x, start, x, min(start + dash, bottom)), TRUTH, 1)


def _labelled(
    pen: ImageDraw.ImageDraw, box: NDArray[np.float64], text: str, colour: str, size: tuple[int, int]
) -> None:
    left, top, right, bottom = box.tolist()
    pen.rectangle((left, top, max(right - 1, left), max(bottom - 1, top)), outline=colour, width=2)
    font = ImageFont.load_default(11)
    _, _, text_width, text_height = font.getbbox(text)
    x = min(max(left, 0), size[0] - text_width - 6)
    y = top - text_height - 5 if top > text_height + 5 else min(bottom, size[1] - text_height - 5)
    pen.rectangle((x, y, x + text_width + 6, y + text_height + 5), fill=colour)
    pen.text((x + 3, y + 1), text, fill="#101418", font=font)


def _encode(picture: Image.Image, kind: str) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, kind, **({"quality": 86} if kind == "JPEG" else {"optimize": True}))
    return stream.getvalue()
