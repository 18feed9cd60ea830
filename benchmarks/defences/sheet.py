"""A picture of every defence on the normal, the patched and the camouflaged vehicle."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

from rauca_core.contract.files import write_bytes
from rauca_core.study.defences import Defence
from rauca_core.study.defences.interface import to_pixels

from .views import Views

TILE, GAP, TITLE = 216, 6, 26
INK, PAPER = "#20242a", "#ffffff"
NAMES = {"none": "no defence", "lgs": "LGS", "pad": "PAD", "jpeg": "JPEG 75", "bits": "5 bits", "median": "median 3"}


def save_sheet(views: Views, defences: Sequence[Defence], out: Path) -> None:
    """Paints from top to bottom, defences from left to right, as JPEG."""
    index = _best_view(views)
    sheet = Image.new(
        "RGB",
        (TITLE + len(defences) * (TILE + GAP), TITLE + len(views.paints) * (TILE + GAP)),
        PAPER,
    )
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(16)
    for column, defence in enumerate(defences):
        x = TITLE + column * (TILE + GAP)
        pen.text((x + TILE / 2, TITLE / 2), NAMES.get(defence.name, defence.name), INK, font, anchor="mm")
        for row, images in enumerate(views.paints.values()):
            tile = _tile(defence(images[index : index + 1])[0])
            sheet.paste(tile, (x, TITLE + row * (TILE + GAP)))
    for row, paint in enumerate(views.paints):
        label = Image.new("RGB", (TILE, TITLE), PAPER)
        ImageDraw.Draw(label).text((TILE / 2, TITLE / 2), paint, INK, font, anchor="mm")
        sheet.paste(label.rotate(90, expand=True), (0, TITLE + row * (TILE + GAP)))
    stream = io.BytesIO()
    sheet.save(stream, "JPEG", quality=80, optimize=True)
    write_bytes(out, stream.getvalue())


def _best_view(views: Views) -> int:
    """The view with the largest box: the vehicle is close, and seen from the side."""
    return max(
        range(len(views.frames)), key=lambda index: float((views.boxes[index, 2:] - views.boxes[index, :2]).prod())
    )


def _tile(image: Tensor) -> Image.Image:
    return Image.fromarray(to_pixels(image)).resize((TILE, TILE), Image.Resampling.LANCZOS)
