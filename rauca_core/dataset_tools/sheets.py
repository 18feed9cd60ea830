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
LABEL = 148


def contact_sheet(
    title: str, rows: dict[str, list[StoredFrame | None]], columns: Sequence[str], tile: int = TILE
) -> Image.Image:
    """One picture of all: a row per weather, a column per view; a hole where a frame was kept out.

    Args:
        rows: frames by weather, as many as there are ``columns``.
    """
    head, left = MARGIN + 62, MARGIN + LABEL
    width = left + len(columns) * (tile + GAP) - GAP + MARGIN
    height = head + len(rows) * (tile + GAP) - GAP + MARGIN
    sheet = Image.new("RGB", (width, height), drawing.PAPER)
    pen = ImageDraw.Draw(sheet)
    pen.text((MARGIN, MARGIN - 8), title, fill=drawing.INK, font=drawing.font(24))
    for column, text in enumerate(columns):
        pen.text((left + column * (tile + GAP), head - 26), text, fill=drawing.SOFT, font=drawing.font(15))
    for row, (weather, frames) in enumerate(rows.items()):
        top = head + row * (tile + GAP)
        _side_label(pen, MARGIN, top + tile / 2, weather)
        for column, stored in enumerate(frames):
            place = left + column * (tile + GAP), top
            if stored is None:
                _hole(pen, place, tile)
            else:
                sheet.paste(drawing.enlarged(stored.image(), tile), place)
    return sheet


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
