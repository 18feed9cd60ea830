"""Where the paint lies and which way it faces, as textures that taps read like any other.

So a pixel's place and smooth normal are means over exactly the paint that the pixel shows, at the price of two sparse
products; no raster beside the taps is needed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sparse
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..contract import Vehicle
from ..render import Pyramid, SparseOperator
from ..render.lookup import TEXELS, read_level
from ..render.mipmap import SUBSAMPLES
from ..render.raster.rasterize import rasterize_atlas
from ..render.surface import find_surface

LIGHT_SIZE = 256  # texels along a light texture: 2 cm of a car


@dataclass(frozen=True, eq=False)
class PaintSurface:
    """A vehicle's paint, for taps of one map size.

    Light textures may be coarser than the map of the paint; taps read them through the finer map.

    Attributes:
        pyramid: that the taps read, T texels on all levels.
        light: of light textures, P texels on the finest level; ``pyramid`` itself where that is no larger.
        spread: None, or the operator from all levels of ``light`` to the finest texels of ``pyramid``.
        positions: (T, 3) float32 metres in the vehicle's frame.
        normals: (T, 3) float32 smooth, of length up to 1.
        texel_positions, texel_normals: (P, 3), the same of the light textures' texels.
    """

    pyramid: Pyramid
    light: Pyramid
    spread: SparseOperator | None
    positions: Tensor
    normals: Tensor
    texel_positions: Tensor
    texel_normals: Tensor

    @staticmethod
    def of(vehicle: Vehicle, pyramid: Pyramid, size: int = LIGHT_SIZE) -> PaintSurface:
        """For taps that read ``pyramid``; light textures of ``size``, or of the pyramid's where that is smaller."""
        light, spread = pyramid, None
        if size < pyramid.size:
            light = Pyramid.of(vehicle, size)
            spread = _between(light, pyramid)
        texels = [torch.from_numpy(a.astype(np.float32)) for a in _geometry(vehicle, light)]
        return PaintSurface(pyramid, light, spread, *(_levels(t, pyramid, light, spread) for t in texels), *texels)

    def levels(self, texels: Tensor) -> Tensor:
        """A light texture (P, 3) on all levels (T, 3) that taps read."""
        return _levels(texels, self.pyramid, self.light, self.spread)

    @cached_property
    def matrix(self) -> sparse.csr_matrix:
        """:meth:`levels` as a matrix (T, P) float32."""
        climbed = _climb(self.light)
        if self.spread is None:
            return climbed
        return (_climb(self.pyramid) @ (as_matrix(self.spread) @ climbed)).tocsr()

    @cached_property
    def differences(self) -> sparse.csr_matrix:
        """First differences (M, P) between texels of a light texture that touch on the map."""
        slots = self.light.slots[0]
        pairs = []
        for a, b in ((slots[:, :-1], slots[:, 1:]), (slots[:-1], slots[1:])):
            both = (a >= 0) & (b >= 0)
            pairs.append(np.stack([a[both], b[both]], 1))
        ends = np.concatenate(pairs)
        rows, signs = np.repeat(np.arange(len(ends)), 2), np.tile(np.array([1, -1], np.float32), len(ends))
        return sparse.csr_matrix((signs, (rows, ends.ravel())), shape=(len(ends), len(self.light.texels)))


def as_matrix(operator: SparseOperator) -> sparse.csr_matrix:
    """The same matrix for SciPy."""
    return sparse.csr_matrix((operator.weights, operator.columns, operator.indptr), shape=operator.shape)


def _levels(texels: Tensor, pyramid: Pyramid, light: Pyramid, spread: SparseOperator | None) -> Tensor:
    every = light(texels)
    return every if spread is None else pyramid(spread(every))


def _between(coarse: Pyramid, fine: Pyramid) -> SparseOperator:
    """Bilinear, from all levels of ``coarse`` to the finest texels of ``fine``; gutters are never read."""
    rows, columns = np.divmod(fine.texels, fine.size)
    uv = np.stack([(columns + 0.5) / fine.size, 1 - (rows + 0.5) / fine.size], 1)
    texels, weights = read_level(coarse, np.zeros(len(uv), np.int64), uv)
    indptr = np.arange(len(uv) + 1, dtype=np.int64) * TEXELS
    return SparseOperator(indptr, texels.ravel(), weights.astype(np.float32).ravel(), coarse.count)


def _climb(pyramid: Pyramid) -> sparse.csr_matrix:
    """Finest texels to all levels, as `Pyramid.__call__`."""
    starts = np.searchsorted(pyramid.tree.level, np.arange(len(pyramid.sizes) + 1))
    blocks = [sparse.identity(starts[1], np.float32, "csr")]
    for fine, coarse, end in zip(starts, starts[1:], starts[2:], strict=False):
        parent, share = pyramid.tree.parent[fine:coarse] - coarse, pyramid.tree.share[fine:coarse]
        step = sparse.csr_matrix((share, (parent, np.arange(coarse - fine))), shape=(end - coarse, coarse - fine))
        blocks.append(step @ blocks[-1])
    return sparse.vstack(blocks).tocsr()


def _geometry(vehicle: Vehicle, pyramid: Pyramid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean places and smooth normals (P, 3) of the paint on each texel: of the subsamples that make its coverage."""
    paint = vehicle.paint_faces()
    uvs = np.where(paint[:, None, None], vehicle.uvs, np.float32(-9))  # other faces lie off the map
    raster = rasterize_atlas(uvs, pyramid.size, SUBSAMPLES)
    surface = find_surface(raster, paint)
    rows, columns = np.nonzero(surface.index >= 0)
    row, column = (rows + raster.y0) // raster.pattern.rows, (columns + raster.x0) // raster.pattern.columns
    slot = pyramid.slots[0][row, column]
    found = []
    for corners in (vehicle.positions[vehicle.triangles], vehicle.normals):
        values, number = surface.interpolate(corners)[slot >= 0], len(pyramid.texels)
        at = slot[slot >= 0]
        total = np.stack([np.bincount(at, values[:, k], number) for k in range(3)], 1)
        found.append(total / np.maximum(np.bincount(at, minlength=number), 1)[:, None])
    return found[0], found[1]
