"""``rauca dataset recolour``: every frame in every colour, as image files, from its light maps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ..contract import Dataset, Progress, RaucaError
from ..contract.colour import srgb_from_linear, to_bytes
from ..contract.files import png_bytes, require_space, write_bytes
from ..contract.recolour import Colour, hex_name, recolour
from .stored_frame import StoredFrame

BYTES_PER_PIXEL = 3


def recolour_dataset(
    folder: Path, colours: Sequence[Colour], out: Path, progress: Callable[[Progress], None] = lambda _: None
) -> int:
    """Write ``out/<colour>/<frame>.png`` (8-bit sRGB) for each frame and colour; images already there are kept.

    Raises:
        RaucaError: the data set has no light maps or no frames, or the disk is too small.
    """
    dataset = Dataset(folder)
    if not dataset.plan.light:
        raise RaucaError(f"{folder}: made without light maps, which recolouring needs; make a data set with light")
    frames = StoredFrame.all_of(dataset)
    if not frames:
        raise RaucaError(f"{folder}: no finished frame to recolour; make the data set first")
    total = len(frames) * len(colours)
    require_space(out, BYTES_PER_PIXEL * dataset.plan.size**2 * total)
    written = 0
    for done, stored in enumerate(frames):
        progress(Progress(done * len(colours), total, stored.frame.id))
        paths = {colour: out / hex_name(colour) / f"{stored.frame.id}.png" for colour in colours}
        wanted = [colour for colour, path in paths.items() if not path.is_file()]
        if not wanted:
            continue
        maps = stored.maps("A", "B")
        for colour, image in zip(wanted, recolour(maps["A"], maps["B"], np.array(wanted)), strict=True):
            write_bytes(paths[colour], png_bytes(to_bytes(srgb_from_linear(image))))
            written += 1
    progress(Progress(total, total, ""))
    return written
