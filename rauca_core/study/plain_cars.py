"""The shipped pictures of plain cars that a detector is shown before anything is rendered.

`tools/preflight_pictures.py` made them, in a town that nothing else uses; they are no part of any battery::

    assets/preflight/pictures.json     the box of the car in each picture
    assets/preflight/<picture>.jpg     sRGB
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..contract import Box
from ..contract.assets import assets_folder
from ..contract.schema import Record, read_json
from ..runtime.images import read_image


@dataclass(frozen=True)
class PlainCar(Record):
    """A picture, and the tight box of the car in it (xyxy, pixels)."""

    file: Annotated[str, "plain_name"]
    box_xyxy: Box


@dataclass(frozen=True)
class PlainCars(Record):
    """All of them, and the command that made them; pictures of the vehicles alternate."""

    FORMAT = ("rauca-plain-cars", 1)

    made: str
    pictures: tuple[PlainCar, ...]


def plain_cars() -> tuple[Tensor, NDArray[np.float64]]:
    """Plain cars that every usual detector finds.

    Returns:
        images (N, 3, H, W) sRGB in [0, 1], and the boxes of the cars (N, 4) xyxy, pixels.

    Raises:
        RaucaError: a file is missing or damaged.
    """
    folder = assets_folder() / "preflight"
    known = PlainCars.from_json(read_json(folder / "pictures.json")).pictures
    pixels = np.stack([read_image(folder / one.file) for one in known])
    images = torch.from_numpy(np.ascontiguousarray(pixels.transpose(0, 3, 1, 2))).float() / 255
    return images, np.array([one.box_xyxy for one in known], np.float64)
