"""Textures that no extractor was taught: noise, a photograph's statistics, and the paper's saturated pattern."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from benchmarks.render.textures import uv_map
from rauca_core.contract import Camouflage, Vehicle, color, save_camouflage
from rauca_core.contract.files import png_bytes
from rauca_core.contract.seeding import named_rng
from rauca_core.render import Pyramid, srgb_to_linear

TEXTURES = ("noise", "photograph-like", "saturated")
CELL = 4  # texels; finer noise is grey from where cameras stand
SATURATED_CELL = 16


def texture(kind: str, pyramid: Pyramid) -> NDArray[np.uint8]:
    """A UV map (size, size, 3), 8-bit sRGB, gutters filled."""
    if kind == "photograph-like":
        return color.to_bytes(color.linear_to_srgb(uv_map(kind, pyramid)))
    cell = CELL if kind == "noise" else SATURATED_CELL
    drawn = named_rng("bench environment", kind).random((-(-pyramid.size // cell),) * 2 + (3,), np.float32)
    if kind == "saturated":
        # As in the published texture, 80 % of the values are at an end of the range.
        drawn = np.clip((drawn - 0.5) * 5 + 0.5, 0, 1)
    whole = drawn.repeat(cell, 0).repeat(cell, 1)[: pyramid.size, : pyramid.size]
    texels = pyramid.from_map(torch.from_numpy(whole.transpose(2, 0, 1).copy()))
    return color.to_bytes(color.linear_to_srgb(pyramid.to_map(texels.pow(2.2)).permute(1, 2, 0).numpy()))


def save_textures(vehicle: Vehicle, size: int, folder: Path) -> dict[str, Path]:
    """Write all as camouflages of a vehicle; returns their JSON files."""
    pyramid, paths = Pyramid.of(vehicle, size), {}
    for kind in TEXTURES:
        paths[kind] = folder / kind / "camouflage.json"
        record = Camouflage(kind, vehicle.name, vehicle.atlas_id, size, "benchmark")
        save_camouflage(paths[kind], record, png_bytes(texture(kind, pyramid)))
    return paths


def texels_of(image_srgb: NDArray[np.uint8], pyramid: Pyramid) -> Tensor:
    """All levels (T, 3), linear, of an 8-bit sRGB UV map."""
    uv = torch.from_numpy(image_srgb.astype(np.float32) / 255).permute(2, 0, 1)
    return pyramid(srgb_to_linear(pyramid.from_map(uv)))
