"""Camouflages that nobody optimized; every result is compared with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from ..contract import Camouflage, RaucaError, Vehicle, save_camouflage
from ..contract.color import to_bytes
from ..contract.files import png_bytes
from ..contract.seeding import named_rng
from ..render import Pyramid
from .texture import map_png


def random_camouflage(path: Path, vehicle: Vehicle, size: int = 1024, seed: int = 0, cell: int = 1) -> Camouflage:
    """Random paint: every cell of the UV map takes a color uniform in sRGB.

    Args:
        path: of the JSON to write; the PNG goes beside it.
        size: side of the UV map, texels.
        cell: side of a cell, texels; the published baseline is 1.

    Raises:
        RaucaError: ``cell`` or ``size`` out of range.
    """
    if not 1 <= cell <= size:
        raise RaucaError(f"cell: {cell} texels on a UV map of {size}; choose 1 to {size}")
    cells = -(-size // cell)
    colors = named_rng(seed, "random camouflage").random((cells, cells, 3), np.float32)
    uv_map = colors.repeat(cell, 0).repeat(cell, 1)[:size, :size]
    pyramid = Pyramid.of(vehicle, size)
    texels = pyramid.from_map(torch.from_numpy(np.ascontiguousarray(uv_map.transpose(2, 0, 1))))
    made = {"seed": seed, "cell_texels": cell}
    camouflage = Camouflage("random", vehicle.name, vehicle.atlas_id, size, "random", made)
    save_camouflage(path, camouflage, map_png(pyramid, texels))
    return camouflage


def plain_camouflage(path: Path, vehicle: Vehicle, srgb: tuple[int, int, int], size: int = 64) -> Camouflage:
    """One color all over; ``srgb`` is 8-bit."""
    if len(srgb) != 3 or not all(0 <= c <= 255 for c in srgb):
        raise RaucaError(f"color: {srgb} is not 8-bit sRGB; give three numbers from 0 to 255")
    pixels: NDArray[np.uint8] = to_bytes(np.broadcast_to(np.array(srgb) / 255.0, (size, size, 3)))
    camouflage = Camouflage("plain", vehicle.name, vehicle.atlas_id, size, "plain", {"srgb": list(srgb)})
    save_camouflage(path, camouflage, png_bytes(pixels))
    return camouflage
