"""The UV map's paintable texels and their coverage-weighted mip pyramid.

A coarse texel is the mean of the *paintable* texels below it, weighted by their coverage: gutters and unpaintable parts
never bleed into it, and texels that nothing covers do not exist at all. The map is therefore a list of texels (P, 3),
not an image, and the pyramid a longer list (T, 3) that begins with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from ..contract import RaucaError, Vehicle
from ..runtime.kernels import njit
from .raster.rasterize import rasterize_atlas
from .sparse import CHANNELS, SparseOperator, apply_many, gather, scatter, with_rows

DILATION_ROUNDS = 8  # texels around each chart that the renderer's bilinear filter and coarse mips may touch
SUBSAMPLES = 2  # squared, per texel of the map; partly covered texels only need a rough weight
ROW = 4  # numbers of a row of `MipmappedTexture`, the last unused


class Tree(NamedTuple):
    """The pyramid as a forest over its list of T texels; parents come after all of their level.

    Attributes:
        parent: (T,) int32 place of the next coarser texel, -1 for the coarsest.
        share: (T,) float32 of its parent; the shares of siblings sum to 1.
        spread: (T,) float32 sum of the children's squared shares, 0 for the finest.
        level: (T,) int8, 0 for the finest, ascending.
    """

    parent: NDArray[np.int32]
    share: NDArray[np.float32]
    spread: NDArray[np.float32]
    level: NDArray[np.int8]


class Pyramid:
    """Layout of a vehicle's paintable texels over all mip levels; linear light throughout.

    Attributes:
        size: of the square UV map, texels.
        texels: (P,) int64 positions ``row * size + column`` of the paintable texels.
        count: T, texels of all levels.
        sizes: side of each level, texels.
        slots: per level (side, side) int32, the texel's place in the list of T, or -1.
        coverage: per level (side, side) float32 in [0, 1].
        flat: for kernels: slots and coverage of all levels one after another, where each begins, and ``sizes``.
        tree: which coarse texel each texel goes into, and with what share.
        spare: per type a buffer that is all zero, lent to the `MipmappedTexture` whose gradient is in work.
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
        starts = np.cumsum([0] + [slot.size for slot in self.slots])
        flat_slots, flat_coverage = (np.concatenate([a.ravel() for a in m]) for m in (self.slots, self.coverage))
        self.flat = flat_slots, flat_coverage, starts, np.array(self.sizes)
        self.texels = np.flatnonzero(coverage > 0)
        if not len(self.texels):
            raise RaucaError("vehicle: no texel of the UV map is paintable at this size; choose a larger map")
        self.tree = _grow_tree(self.slots, self.coverage)
        self.spare: dict[np.dtype[Any], NDArray[Any]] = {}

    @staticmethod
    def of(vehicle: Vehicle, size: int) -> Pyramid:
        """The pyramid of a vehicle's atlas at ``size`` texels."""
        return Pyramid(texel_coverage(vehicle, size))

    @cached_property
    def _levels(self) -> list[SparseOperator]:
        """Level to the next coarser level, as operators between their parts of the list."""
        starts = np.searchsorted(self.tree.level, np.arange(len(self.sizes) + 1))
        steps = []
        for fine, coarse, end in zip(starts, starts[1:], starts[2:], strict=False):
            parent, share = self.tree.parent[fine:coarse] - coarse, self.tree.share[fine:coarse]
            indptr = np.concatenate([[0], np.cumsum(np.bincount(parent, minlength=end - coarse))]).astype(np.int64)
            order = np.argsort(parent, kind="stable").astype(np.int32)
            steps.append(SparseOperator(indptr, order, share[order], int(coarse - fine)))
        return steps

    def __call__(self, texels_linear: Tensor) -> Tensor:
        """Texels (P, 3) linear -> all levels (T, 3) linear."""
        if texels_linear.dtype in (torch.float16, torch.bfloat16):
            texels_linear = texels_linear.float()  # means of means, and gradients summed over texels, need the digits
        if texels_linear.device.type == "cpu":
            every: Tensor = _Climb.apply(texels_linear, self.tree)
            return every
        levels = [texels_linear]
        for step in self._levels:
            levels.append(step(levels[-1]))
        return torch.cat(levels)

    def from_map(self, uv_map: Tensor) -> Tensor:
        """The paintable texels (P, 3) of a UV map (3, size, size)."""
        index = torch.from_numpy(self.texels).to(uv_map.device)
        return uv_map.reshape(3, -1).index_select(1, index).T.contiguous()

    def to_map(self, texels: Tensor) -> Tensor:
        """A UV map (3, size, size) from texels (P, 3), unpaintable texels filled from their paintable neighbors.

        Whoever filters the map without knowing its coverage (Cycles, a game engine) then meets no foreign color. Give
        linear texels: the filling averages light.
        """
        levels = self(texels.detach().cpu())
        color = np.zeros((self.sizes[-1], self.sizes[-1], 3), np.float32)
        for slot in reversed(self.slots):
            scale = len(slot) // len(color)
            color = color.repeat(scale, 0).repeat(scale, 1)
            inside = slot >= 0
            color[inside] = levels[torch.from_numpy(slot[inside].astype(np.int64))].numpy()
        _dilate(color, np.where(self.slots[0] >= 0, 0, -1).astype(np.int8))
        return torch.from_numpy(np.ascontiguousarray(color.transpose(2, 0, 1)))


def texel_coverage(vehicle: Vehicle, size: int) -> NDArray[np.float32]:
    """Paintable share (size, size) in [0, 1] of each texel, row 0 at the top: charts of paint faces times the mask.

    UVs outside [0, 1] lie beyond the map and cover nothing.
    """
    raster = rasterize_atlas(vehicle.uvs[vehicle.paint_faces()], size, SUBSAMPLES)
    rows, columns = raster.pattern.rows, raster.pattern.columns
    hit = raster.whole(size, size).reshape(size, rows, size, columns) >= 0
    charts = hit.mean((1, 3), dtype=np.float32)
    mask = Image.fromarray(vehicle.paint_mask).resize((size, size), Image.Resampling.BOX)
    return charts * (np.asarray(mask, np.float32) / np.float32(255))


@njit(cache=True, nogil=True)
def _dilate(color: Any, since: Any) -> None:
    """Grow known colors outwards in place, one texel per round, by the mean of known neighbors.

    ``since``: the round in which a texel became known, 0 at first; -1 until then.
    """
    height, width = since.shape
    for turn in range(1, DILATION_ROUNDS + 1):
        for y in range(height):
            for x in range(width):
                if since[y, x] >= 0:
                    continue
                red = green = blue = number = 0.0
                for row in range(max(0, y - 1), min(height, y + 2)):
                    for column in range(max(0, x - 1), min(width, x + 2)):
                        if 0 <= since[row, column] < turn:
                            red += color[row, column, 0]
                            green += color[row, column, 1]
                            blue += color[row, column, 2]
                            number += 1.0
                if number > 0.0:
                    color[y, x, 0], color[y, x, 1], color[y, x, 2] = red / number, green / number, blue / number
                    since[y, x] = turn


def _grow_tree(slots: list[NDArray[np.int32]], coverage: list[NDArray[np.float32]]) -> Tree:
    count = max(int(slot.max()) for slot in slots) + 1
    tree = Tree(
        np.full(count, -1, np.int32), np.zeros(count, np.float32), np.zeros(count, np.float32), np.zeros(count, np.int8)
    )
    for level, slot in enumerate(slots):
        inside = slot >= 0
        tree.level[slot[inside]] = level
        if level + 1 < len(slots):
            above, total = (
                np.kron(a, np.ones((2, 2), a.dtype))[inside] for a in (slots[level + 1], coverage[level + 1])
            )
            share = coverage[level][inside] / (4 * total)
            tree.parent[slot[inside]], tree.share[slot[inside]] = above, share
            tree.spread[:] += np.bincount(above, share**2, count).astype(np.float32)
    return tree


class _Climb(torch.autograd.Function):
    """All coarser levels in one pass over the list, and their gradient in one pass back."""

    @staticmethod
    def forward(ctx: Any, texels: Tensor, tree: Tree) -> Tensor:
        ctx.tree = tree
        every = texels.new_empty((len(tree.parent), CHANNELS))
        climb(with_rows(texels.detach()).numpy(), every.numpy(), tree.parent, tree.share)
        return every

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        every = gradients[0].clone(memory_format=torch.contiguous_format)
        texels = every.new_empty((int(np.searchsorted(ctx.tree.level, 1)), CHANNELS))
        hand_down(every.numpy(), ctx.tree.parent, ctx.tree.share, texels.numpy())
        return texels, None


@njit(cache=True, nogil=True)
def climb(texels: Any, every: Any, parent: Any, share: Any) -> None:
    """All levels ``every`` (T, 3 or more) of ``texels`` (P, 3)."""
    finest = np.uint64(texels.shape[0])
    every[finest:] = 0
    for t in range(np.uint64(every.shape[0])):
        source = texels[t] if t < finest else every[t]
        red, green, blue = source[0], source[1], source[2]
        if t < finest:
            every[t, 0], every[t, 1], every[t, 2] = red, green, blue
        if parent[t] >= 0:
            p, part = np.uint32(parent[t]), share[t]
            every[p, 0] += part * red
            every[p, 1] += part * green
            every[p, 2] += part * blue


@njit(cache=True, nogil=True)
def hand_down(every: Any, parent: Any, share: Any, texels: Any) -> None:
    """Gradient on the ``texels`` (P, 3) from gradients on ``every`` level (T, 3 or more), which is left all zero."""
    finest = np.uint64(texels.shape[0])
    for n in range(every.shape[0]):
        t = np.uint64(every.shape[0] - 1 - n)
        red, green, blue = every[t, 0], every[t, 1], every[t, 2]
        if parent[t] >= 0:
            p, part = np.uint32(parent[t]), share[t]
            red += part * every[p, 0]
            green += part * every[p, 1]
            blue += part * every[p, 2]
        if t < finest:
            texels[t, 0], texels[t, 1], texels[t, 2] = red, green, blue
            every[t, 0] = every[t, 1] = every[t, 2] = 0
        else:
            every[t, 0], every[t, 1], every[t, 2] = red, green, blue
    every[finest:] = 0


class MipmappedTexture:
    """All mip levels of one texture of a step: what views sample, and their gradients on the way back.

    ``sample(operators)`` is, to the bit, ``apply_many(operators, pyramid(texels))``. But all levels of a map of 2048
    texels a side are tens of megabytes: clearing a gradient of that size takes longer than filling in what a view has
    to say. Here all views of a step add to one buffer, and the pass that hands it down the levels leaves it clear for
    the next step. Rows have a fourth number, so that none straddles a cache line.

    Attributes:
        ticket: stands between the texels and all views in autograd's graph. On the CPU it is a scalar whose gradient,
            always 0, tells that the gradients of all views lie in the buffer.
    """

    def __init__(self, pyramid: Pyramid, texels_linear: Tensor) -> None:
        """Climb all levels from texels (P, 3) on any device; half precision is computed in float32."""
        self._tensor: Tensor | None = None
        if texels_linear.device.type != "cpu":
            self._tensor = self.ticket = pyramid(texels_linear)
            return
        if texels_linear.dtype in (torch.float16, torch.bfloat16):
            texels_linear = texels_linear.float()
        values = with_rows(texels_linear.detach()).numpy()
        self._levels = np.empty((pyramid.count, ROW), values.dtype)
        climb(values, self._levels, pyramid.tree.parent, pyramid.tree.share)
        self._sums = _Sums(pyramid, values.dtype)
        self.ticket = _Ticket.apply(texels_linear, self._sums)

    def sample(self, operators: Sequence[SparseOperator]) -> Tensor:
        """Colors (sum of rows, 3), linear, of several views, stacked."""
        if self._tensor is not None:
            return apply_many(operators, self._tensor)
        pixels: Tensor = _Sample.apply(self.ticket, tuple(operators), self._levels, self._sums)
        return pixels


class _Sums:
    """The gradient on all levels, summed over the views of one backward pass.

    The buffer is borrowed from the pyramid. One that a failed pass leaves behind is not returned: it is not clear.
    """

    def __init__(self, pyramid: Pyramid, dtype: np.dtype[Any]) -> None:
        self._pyramid, self._dtype = pyramid, dtype
        self._buffer: NDArray[Any] | None = None

    def add(self, operators: Sequence[SparseOperator], gradient: Tensor) -> None:
        if self._buffer is None:
            spare = self._pyramid.spare.pop(self._dtype, None)
            self._buffer = np.zeros((self._pyramid.count, ROW), self._dtype) if spare is None else spare
        scatter(operators, gradient, self._buffer)

    def hand_down(self) -> Tensor:
        """The gradient (P, 3) on the texels; the buffer goes back."""
        buffer, self._buffer = self._buffer, None
        tree, number = self._pyramid.tree, len(self._pyramid.texels)
        if buffer is None:
            return torch.from_numpy(np.zeros((number, CHANNELS), self._dtype))
        texels = np.empty((number, CHANNELS), self._dtype)
        hand_down(buffer, tree.parent, tree.share, texels)
        self._pyramid.spare[self._dtype] = buffer
        return torch.from_numpy(texels)


class _Ticket(torch.autograd.Function):
    """Autograd calls ``backward`` when every view's gradient has arrived."""

    @staticmethod
    def forward(ctx: Any, texels: Tensor, sums: _Sums) -> Tensor:
        ctx.sums = sums
        return texels.new_zeros(())

    @staticmethod
    def backward(ctx: Any, *_gradients: Tensor) -> tuple[Tensor, None]:
        return ctx.sums.hand_down(), None


class _Sample(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, ticket: Tensor, operators: tuple[SparseOperator, ...], levels: NDArray[Any], sums: _Sums
    ) -> Tensor:
        ctx.operators, ctx.sums = operators, sums
        return gather(operators, levels)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None, None]:
        ctx.sums.add(ctx.operators, gradients[0])
        return gradients[0].new_zeros(()), None, None, None
