"""Finished camouflages, the UV map and how it was made; and random paint, which every result is compared with."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..contract import Camouflage, RaucaError, Vehicle, load_camouflage, save_camouflage
from ..contract.color import to_bytes
from ..contract.files import png_bytes
from ..contract.seeding import named_rng
from ..render import Pyramid, linear_to_srgb, srgb_to_linear
from ..runtime.images import read_image


@dataclass(frozen=True, eq=False)
class Paint:
    """A finished camouflage.

    Attributes:
        record: which vehicle and UV layout it fits, and how it was made.
        texture: (size, size, 3) uint8 sRGB, the UV map, row 0 at the top, gutters filled.
        path: of its JSON file; None while it is in memory alone.
        history: of every step that made it, as in ``history.jsonl``; empty where that is not known.
    """

    record: Camouflage
    texture: NDArray[np.uint8]
    path: Path | None = None
    history: list[dict[str, float]] = field(default_factory=list)

    @property
    def name(self) -> str:
        return self.record.name

    def save(self, path: Path | str) -> Path:
        """Write the JSON to ``path`` and the UV map beside it as PNG; returns the JSON's path."""
        path = Path(path).with_suffix(".json")
        save_camouflage(path, self.record, png_bytes(self.texture))
        return path


def load_paint(path: Path | str) -> Paint:
    """Read a camouflage by the path of its JSON or PNG.

    Raises:
        RaucaError: one of the two files is missing or damaged.
    """
    record, image = load_camouflage(Path(path))
    return Paint(record, read_image(image), image.with_suffix(".json"))


def map_png(pyramid: Pyramid, texels_srgb: Tensor) -> bytes:
    """Texels (P, 3) sRGB as the PNG of a UV map, gutters filled so that no filter bleeds foreign color."""
    uv_map = linear_to_srgb(pyramid.to_map(srgb_to_linear(texels_srgb.detach().cpu())))
    return png_bytes(to_bytes(uv_map.permute(1, 2, 0).numpy()))


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
