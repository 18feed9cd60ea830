"""A contact sheet of weathers by views, and sheets that lay a frame open."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

from ..contract.semantics import CLASSES
from . import drawing
from .stored_frame import StoredFrame
from .targets import Target

TILE = 240
GAP = 6
MARGIN = 28
SHEET_SIDE = 460
LABEL = 112
HEAD = MARGIN + 62
MOST_ROWS = 8


def contact_sheet(
    title: str, rows: dict[str, list[StoredFrame | None]], columns: Sequence[str], tile: int = TILE
) -> Image.Image:
    """One picture of all: a row per weather, a column per view; a hole where a frame was kept out.

    More than eight rows stand in blocks beside each other, so that a sheet of 16 weathers fits a page.

    Args:
        rows: frames by weather, as many as there are ``columns``.
    """
    names = list(rows)
    blocks = -(-len(names) // MOST_ROWS)
    high = -(-len(names) // blocks)
    block_width = LABEL + len(columns) * (tile + GAP) - GAP + MARGIN
    size = MARGIN + blocks * block_width, HEAD + high * (tile + GAP) - GAP + MARGIN
    sheet = Image.new("RGB", size, drawing.PAPER)
    pen = ImageDraw.Draw(sheet)
    pen.text((MARGIN, MARGIN - 8), title, fill=drawing.INK, font=drawing.font(24))
    for block in range(blocks):
        left = MARGIN + block * block_width
        for column, text in enumerate(columns):
            place = left + LABEL + column * (tile + GAP), HEAD - 26
            pen.text(place, text, fill=drawing.SOFT, font=drawing.font(15))
        for row, weather in enumerate(names[block * high : (block + 1) * high]):
            _row(sheet, (left, HEAD + row * (tile + GAP)), weather, rows[weather], tile)
    return sheet


def _row(sheet: Image.Image, corner: tuple[int, int], name: str, frames: list[StoredFrame | None], tile: int) -> None:
    """A weather's name and its tiles, from the upper left ``corner`` on."""
    left, top = corner
    pen = ImageDraw.Draw(sheet)
    _side_label(pen, left, top + tile / 2, name)
    for column, stored in enumerate(frames):
        place = left + LABEL + column * (tile + GAP), top
        if stored is None:
            _hole(pen, place, tile)
        else:
            sheet.paste(drawing.enlarged(stored.image(), tile), place)


def frame_sheet(stored: StoredFrame, targets: list[Target], side: int = SHEET_SIDE) -> Image.Image:
    """A frame three ways: as it is, with boxes and the paint's outline, with its classes; and the legend."""
    views = [
        ("image", drawing.enlarged(stored.image(), side)),
        ("boxes, and the outline of the paint", drawing.with_boxes(stored, targets, side)),
        ("semantic classes and instances", drawing.with_classes(stored, side)),
    ]
    classes = [number for number in np.unique(stored.image("semantic.png")).tolist() if number < len(CLASSES)]
    width = 2 * MARGIN + len(views) * (side + GAP) - GAP
    legend = drawing.legend(classes, width - 2 * MARGIN)
    head = MARGIN + 56
    sheet = Image.new("RGB", (width, head + side + 16 + legend.height + MARGIN // 2), drawing.PAPER)
    pen = ImageDraw.Draw(sheet)
    pen.text((MARGIN, MARGIN - 8), _described(stored), fill=drawing.INK, font=drawing.font(19))
    for column, (caption, view) in enumerate(views):
        left = MARGIN + column * (side + GAP)
        pen.text((left, head - 24), caption, fill=drawing.SOFT, font=drawing.font(15))
        sheet.paste(view, (left, head))
    sheet.paste(legend, (MARGIN, head + side + 16))
    return sheet


def _described(stored: StoredFrame) -> str:
    frame = stored.frame
    return (
        f"{frame.id}    azimuth {frame.azimuth_deg:.0f}°, elevation {frame.elevation_deg:.0f}°, "
        f"{frame.distance_m:.1f} m, {100 * frame.visible:.0f} % of the paint visible"
    )


def _side_label(pen: ImageDraw.ImageDraw, left: float, middle: float, text: str) -> None:
    """A weather's name beside its row, broken at hyphens where it is too long."""
    face = drawing.font(16)
    lines = [""]
    for part in text.replace("-", "- ").split(" "):
        longer = lines[-1] + part
        if face.getlength(longer) > LABEL - 12 and lines[-1]:
            lines.append(part)
        else:
            lines[-1] = longer
    top = middle - 10 * len(lines)
    for number, line in enumerate(lines):
        pen.text((left, top + 20 * number), line, fill=drawing.INK, font=face)


def _hole(pen: ImageDraw.ImageDraw, place: tuple[int, int], tile: int) -> None:
    left, top = place
    pen.rectangle((left, top, left + tile - 1, top + tile - 1), fill="#f0f2f5")
    pen.text((left + tile / 2, top + tile / 2), "kept out", fill=drawing.SOFT, font=drawing.font(15), anchor="mm")
