"""Frames with what is known of them drawn in: boxes, classes, the outline of the paint."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ..contract.semantics import CLASSES, PALETTE
from .stored_frame import StoredFrame
from .targets import Target

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
    inside = mask.copy()
    inside[1:] &= mask[:-1]
    inside[:-1] &= mask[1:]
    inside[:, 1:] &= mask[:, :-1]
    inside[:, :-1] &= mask[:, 1:]
    return mask & ~inside


def legend(classes: list[int], width: int) -> Image.Image:
    """Names and colors of classes, in as many rows as ``width`` pixels ask for."""
    text, swatch, gap, row = font(14), 13, 16, 25
    places, x, y = [], 0, 0
    for number in classes:
        length = swatch + 7 + int(text.getlength(_spoken(CLASSES[number])))
        if x and x + length > width:
            x, y = 0, y + row
        places.append((x, y, number))
        x += length + gap
    picture = Image.new("RGB", (width, y + row), PAPER)
    pen = ImageDraw.Draw(picture)
    for x, y, number in places:
        pen.rounded_rectangle((x, y + 5, x + swatch, y + 5 + swatch), 3, fill=tuple(PALETTE[number].tolist()))
        pen.text((x + swatch + 7, y + 3), _spoken(CLASSES[number]), fill=INK, font=text)
    return picture


def _spoken(name: str) -> str:
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
