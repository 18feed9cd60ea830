"""``rauca dataset recolor``: every frame in every color, as image files, from its light maps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..contract import Dataset, Progress, RaucaError
from ..contract.color import Color, hex_name, linear_to_srgb, recolor, to_bytes
from ..contract.files import disk_errors, png_bytes, read_sums, require_space, write_bytes, write_json
from ..contract.schema import read_json
from .stored import StoredFrame

BYTES_PER_PIXEL = 3
NOTE = "recolor.json"


def recolor_dataset(
    folder: Path, colors: Sequence[Color], out: Path, progress: Callable[[Progress], None] = lambda _: None
) -> int:
    """Write ``out/<color>/<frame>.png`` (8-bit sRGB) for each frame and color.

    Images already there are kept if they come from the same light maps, and are written again otherwise.

    Raises:
        RaucaError: the data set has no light maps or no frames, a frame has no checksums, or the disk is too small.
    """
    dataset = Dataset(folder)
    if not dataset.plan.light:
        raise RaucaError(f"{folder}: made without light maps, which recoloring needs; make a data set with light")
    frames = StoredFrame.all_of(dataset, "recolor")
    origins = {stored.frame.id: read_sums(stored.folder).get("passes.npz", "")[:16] for stored in frames}
    missing = sum(_claim(out / hex_name(color), origins) for color in colors)
    require_space(out, BYTES_PER_PIXEL * dataset.plan.size**2 * missing)
    total, written = len(frames) * len(colors), 0
    for done, stored in enumerate(frames):
        progress(Progress(done * len(colors), total, stored.frame.id))
        paths = {color: out / hex_name(color) / f"{stored.frame.id}.png" for color in colors}
        wanted = [color for color, path in paths.items() if not path.is_file()]
        if not wanted:
            continue
        maps = stored.maps("A", "B")
        for color, image in zip(wanted, recolor(maps["A"], maps["B"], np.array(wanted)), strict=True):
            write_bytes(paths[color], png_bytes(to_bytes(linear_to_srgb(image))))
            written += 1
    progress(Progress(total, total, ""))
    return written


def _claim(folder: Path, origins: dict[str, str]) -> int:
    """Bind a color's ``folder`` to light maps, by their hashes; images of others are removed.

    Frames of all data sets have the same names, so these would be mistaken for this one's.

    Returns:
        How many images are missing.
    """
    noted = _noted(folder / NOTE)
    there = {path.stem: path for path in folder.glob("*.png")}
    with disk_errors(folder):
        for frame, path in there.items():
            if noted.get(frame) != origins.get(frame):
                path.unlink()
    if noted != origins:
        write_json(folder / NOTE, origins)
    return sum(frame not in there or noted.get(frame) != origin for frame, origin in origins.items())


def _noted(note: Path) -> dict[str, Any]:
    """What light maps the images beside ``note`` come from; empty when it does not say, or is damaged."""
    try:
        fields = read_json(note)
    except RaucaError:
        return {}
    return {frame: fields.raw(frame) for frame in fields.names()}
