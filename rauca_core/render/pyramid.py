"""The UV map's paintable texels and their coverage-weighted mip pyramid.

A coarse texel is the mean of the *paintable* texels below it, weighted by their coverage: gutters and unpaintable parts
never bleed into it, and texels that nothing covers do not exist at all. The map is therefore a list of texels (P, 3),
not an image, and the pyramid a longer list (T, 3) that begins with it.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..contract import RaucaError, Vehicle
from .coverage import texel_coverage
from .sparse import SparseOperator

DILATION_ROUNDS = 8  # texels around each chart that the renderer's bilinear filter and coarse mips may touch


class Pyramid:
    """Layout of a vehicle's paintable texels over all mip levels; linear light throughout.

    Attributes:
        size: of the square UV map, texels.
        texels: (P,) int64 positions ``row * size + column`` of the paintable texels.
        count: T, texels of all levels.
        sizes: side of each level, texels.
        slots: per level (side, side) int32, the texel's place in the list of T, or -1.
        coverage: per level (side, side) float32 in [0, 1].
    """

    def __init__(self, coverage: NDArray[np.float32]) -> None:
        self.size = coverage.shape[0]
        self.coverage, self.sizes = [coverage], [self.size]
        while self.sizes[-1] % 2 == 0:
            half = self.sizes[-1] // 2
            self.sizes.append(half)
            self.coverage.append(self.coverage[-1].reshape(half, 2, half, 2).mean((1, 3)))
        self.slots, start = [], 0
        for level in self.coverage:
            slot, inside = np.full(level.shape, -1, np.int32), level > 0
            number = int(inside.sum())
            slot[inside] = start + np.arange(number, dtype=np.int32)
            self.slots.append(slot)
            start += number
        self.count = start
        self.texels = np.flatnonzero(coverage > 0)
        if not len(self.texels):
            raise RaucaError("vehicle: no texel of the UV map is paintable at this size; choose a larger map")
        self._reduce = [self._level(i) for i in range(1, len(self.sizes))]

    @staticmethod
    def of(vehicle: Vehicle, size: int) -> Pyramid:
        """The pyramid of a vehicle's atlas at ``size`` texels."""
        return Pyramid(texel_coverage(vehicle, size))

    def _level(self, level: int) -> SparseOperator:
        """Level - 1 to level, as an operator between their parts of the list."""
        fine, side = self.coverage[level - 1], self.sizes[level]
        blocks = fine.reshape(side, 2, side, 2).transpose(0, 2, 1, 3).reshape(-1, 4)
        slots = self.slots[level - 1].reshape(side, 2, side, 2).transpose(0, 2, 1, 3).reshape(-1, 4)
        inside = self.coverage[level].ravel() > 0
        blocks, slots = blocks[inside], slots[inside]
        weights = blocks / blocks.sum(1, keepdims=True)
        used = slots >= 0
        indptr = np.concatenate([[0], np.cumsum(used.sum(1))]).astype(np.int64)
        first = self.slots[level - 1].max(initial=-1) + 1 - int((fine > 0).sum())
        return SparseOperator(
            indptr, (slots[used] - first).astype(np.int32), weights[used].astype(np.float32), int((fine > 0).sum())
        )

    def __call__(self, texels_linear: Tensor) -> Tensor:
        """Texels (P, 3) linear -> all levels (T, 3) linear."""
        levels = [texels_linear]
        for reduce in self._reduce:
            levels.append(reduce(levels[-1]))
        return torch.cat(levels)

    def from_map(self, uv_map: Tensor) -> Tensor:
        """The paintable texels (P, 3) of a UV map (3, size, size)."""
        index = torch.from_numpy(self.texels).to(uv_map.device)
        return uv_map.reshape(3, -1).index_select(1, index).T.contiguous()

    def to_map(self, texels: Tensor) -> Tensor:
        """A UV map (3, size, size) from texels (P, 3), unpaintable texels filled from their paintable neighbours.

        Whoever filters the map without knowing its coverage (Cycles, a game engine) then meets no foreign colour. Give
        linear texels: the filling averages light.
        """
        levels = self(texels.detach().cpu())
        colour = np.zeros((self.sizes[-1], self.sizes[-1], 3), np.float32)
        for slot in reversed(self.slots):
            scale = len(slot) // len(colour)
            colour = colour.repeat(scale, 0).repeat(scale, 1)
            inside = slot >= 0
            colour[inside] = levels[torch.from_numpy(slot[inside].astype(np.int64))].numpy()
        _dilate(colour, self.slots[0] >= 0)
        return torch.from_numpy(np.ascontiguousarray(colour.transpose(2, 0, 1)))


def _dilate(colour: NDArray[np.float32], inside: NDArray[np.bool_]) -> None:
    """Grow the colours of ``inside`` outwards in place, one texel per round, by the mean of known neighbours."""
    height, width = inside.shape
    known = np.pad(inside, 1)
    for _ in range(DILATION_ROUNDS):
        padded = np.pad(colour, ((1, 1), (1, 1), (0, 0)))
        total, number = np.zeros_like(colour), np.zeros((height, width), np.float32)
        for dy in range(3):
            for dx in range(3):
                near = known[dy : dy + height, dx : dx + width]
                total += padded[dy : dy + height, dx : dx + width] * near[..., None]
                number += near
        new = (number > 0) & ~known[1:-1, 1:-1]
        if not new.any():
            return
        colour[new] = total[new] / number[new, None]
        known[1:-1, 1:-1] |= new
