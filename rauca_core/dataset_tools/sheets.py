"""A contact sheet of weathers by views; sheets that show a frame with boxes, classes and the outline of its paint."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ..contract.semantics import CLASSES, PALETTE
from .stored import StoredFrame, Target

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
    sheet = Image.new("RGB", size, PAPER)
    pen = ImageDraw.Draw(sheet)
    pen.text((MARGIN, MARGIN - 8), title, fill=INK, font=font(24))
    for block in range(blocks):
        left = MARGIN + block * block_width
        for column, text in enumerate(columns):
            place = left + LABEL + column * (tile + GAP), HEAD - 26
            pen.text(place, text, fill=SOFT, font=font(15))
        for row, weather in enumerate(names[block * high : (block + 1) * high]):
            _row(sheet, (left, HEAD + row * (tile + GAP)), weather, rows[weather], tile)
    return sheet


def _row(sheet: Image.Image, corner: tuple[int, int], name: str, frames: list[StoredFrame | None], tile: int) -> None:
    """A weather's name and its tiles, from the upper left ``corner`` on."""
    left, top = corner
    pen = ImageDraw.Draw(sheet)
    _side_label(pen, left, top + tile / 2, name)
    for column, stored in enumerate(frames):
        x = left + LABEL + column * (tile + GAP)
        if stored is None:
            pen.rectangle((x, top, x + tile - 1, top + tile - 1), fill="#f0f2f5")
            pen.text((x + tile / 2, top + tile / 2), "kept out", fill=SOFT, font=font(15), anchor="mm")
        else:
            sheet.paste(enlarged(stored.image(), tile), (x, top))


def frame_sheet(stored: StoredFrame, targets: list[Target]) -> Image.Image:
    """A frame three ways: as it is, with boxes and the paint's outline, with its classes; and the legend."""
    side = SHEET_SIDE
    frame = stored.frame
    title = (
        f"{frame.id}    azimuth {frame.azimuth_deg:.0f}°, elevation {frame.elevation_deg:.0f}°, "
        f"{frame.distance_m:.1f} m, {100 * frame.visible:.0f} % of the paint visible"
    )
    views = [
        ("image", enlarged(stored.image(), side)),
        ("boxes, and the outline of the paint", with_boxes(stored, targets, side)),
        ("semantic classes and instances", with_classes(stored, side)),
    ]
    classes = [number for number in np.unique(stored.image("semantic.png")).tolist() if number < len(CLASSES)]
    width = 2 * MARGIN + len(views) * (side + GAP) - GAP
    names = legend(classes, width - 2 * MARGIN)
    head = MARGIN + 56
    sheet = Image.new("RGB", (width, head + side + 16 + names.height + MARGIN // 2), PAPER)
    pen = ImageDraw.Draw(sheet)
    pen.text((MARGIN, MARGIN - 8), title, fill=INK, font=font(19))
    for column, (caption, view) in enumerate(views):
        left = MARGIN + column * (side + GAP)
        pen.text((left, head - 24), caption, fill=SOFT, font=font(15))
        sheet.paste(view, (left, head))
    sheet.paste(names, (MARGIN, head + side + 16))
    return sheet


def _side_label(pen: ImageDraw.ImageDraw, left: float, middle: float, text: str) -> None:
    """A weather's name beside its row, broken at hyphens where it is too long."""
    face = font(16)
    lines = [""]
    for part in text.replace("-", "- ").split(" "):
        longer = lines[-1] + part
        if face.getlength(longer) > LABEL - 12 and lines[-1]:
            lines.append(part)
        else:
            lines[-1] = longer
    top = middle - 10 * len(lines)
    for number, line in enumerate(lines):
        pen.text((left, top + 20 * number), line, fill=INK, font=face)


INK, SOFT, PAPER, LINE = "#1d2430", "#5b6675", "#ffffff", "#dfe4ea"
TARGET_COLOR, OTHER_COLOR = "#2ee6a8", "#ffb300"
PAINT_OUTLINE = (255, 255, 255)
CLASS_SHARE = 0.7  # of the class's color in a pixel of the semantic view

Pixels = NDArray[np.uint8]


def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Pillow's own typeface: the same picture on every machine."""
    return ImageFont.load_default(size)


def enlarged(pixels: Pixels, side: int) -> Image.Image:
    """A picture at ``side`` pixels."""
    return Image.fromarray(pixels).convert("RGB").resize((side, side), Image.Resampling.LANCZOS)


def with_boxes(stored: StoredFrame, targets: list[Target], side: int) -> Image.Image:
    """The frame with boxes of our vehicle (green) and others (amber), and the outline of the paint (white)."""
    image = stored.image()
    scale = side / image.shape[1]
    paint = Image.fromarray(stored.image("paint.png")).resize((side, side), Image.Resampling.BICUBIC)
    pixels = np.asarray(enlarged(image, side)).copy()
    pixels[outline(np.asarray(paint) >= 128)] = PAINT_OUTLINE
    picture = Image.fromarray(pixels)
    for number, target in enumerate(targets):
        first = number == 0 and stored.frame.box_xyxy is not None
        _box(picture, [v * scale for v in target.box_xyxy], target.category, TARGET_COLOR if first else OTHER_COLOR)
    return picture


def with_classes(stored: StoredFrame, side: int) -> Image.Image:
    """The frame under the colors of its semantic classes, other vehicles outlined."""
    semantic, instances = stored.image("semantic.png"), stored.image("instances.png")
    grey = stored.image().mean(axis=2, keepdims=True)
    mixed = (1 - CLASS_SHARE) * grey + CLASS_SHARE * PALETTE[np.minimum(semantic, len(CLASSES) - 1)]
    picture = np.asarray(Image.fromarray(mixed.astype(np.uint8)).resize((side, side), Image.Resampling.NEAREST)).copy()
    which = np.asarray(Image.fromarray(instances).resize((side, side), Image.Resampling.NEAREST))
    edge = np.zeros(which.shape, bool)
    edge[:-1] |= which[:-1] != which[1:]
    edge[:, :-1] |= which[:, :-1] != which[:, 1:]
    picture[edge] = (255, 255, 255)
    return Image.fromarray(picture)


def outline(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels of a mask whose neighbor, above, below or beside, is outside it."""
    import cv2  # here: commands that draw nothing do not wait for it

    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    return mask & (cv2.erode(mask.astype(np.uint8), cross) == 0)


def legend(classes: list[int], width: int) -> Image.Image:
    """Names and colors of classes, in as many rows as ``width`` pixels ask for."""
    text, swatch, gap, row = font(14), 13, 16, 25
    places, x, y = [], 0, 0
    for number in classes:
        length = swatch + 7 + int(text.getlength(_in_words(CLASSES[number])))
        if x and x + length > width:
            x, y = 0, y + row
        places.append((x, y, number))
        x += length + gap
    picture = Image.new("RGB", (width, y + row), PAPER)
    pen = ImageDraw.Draw(picture)
    for x, y, number in places:
        pen.rounded_rectangle((x, y + 5, x + swatch, y + 5 + swatch), 3, fill=tuple(PALETTE[number].tolist()))
        pen.text((x + swatch + 7, y + 3), _in_words(CLASSES[number]), fill=INK, font=text)
    return picture


def _in_words(name: str) -> str:
    return name.replace("_", " ")


def _box(picture: Image.Image, box: list[float], text: str, color: str) -> None:
    pen, face = ImageDraw.Draw(picture), font(16)
    left, top, right, bottom = box
    pen.rectangle((left, top, max(right - 1, left), max(bottom - 1, top)), outline=color, width=2)
    width, height = int(face.getlength(text)) + 8, 21
    x = min(max(left, 0), picture.width - width)
    y = top - height if top >= height else min(top, picture.height - height)
    pen.rectangle((x, y, x + width, y + height), fill=color)
    pen.text((x + 4, y + 1), text, fill="#101418", font=face)
