"""The paper's Algorithm 2 as published: the facet texture tensor T_fc is filled from the UV map anew at every step.

`rauca_core/render/facets.py` turns it into an operator once; these kernels measure what that saves. Finding the face of
every texel and pixel anew, by testing all faces, is left out. Loops are serial. ``uvs`` is (nf, 3, 2) float64.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rauca_core.contract import Camera, Vehicle
from rauca_core.render import SparseOperator, rasterize
from rauca_core.render.facets import facet_fragments
from rauca_core.render.raster.pattern import pattern
from rauca_core.render.raster.rasterize import rasterize_atlas
from rauca_core.render.sampler import TEXTURE_SIZE
from rauca_core.render.sparse import from_triplets
from rauca_core.render.surface import find_surface
from rauca_core.runtime.kernels import njit

SUBSAMPLES = 2  # per pixel and axis, as published


class Facets(NamedTuple):
    """What of a vehicle's paint depends on geometry alone: UVs (nf, 3, 2), the face (size, size) under each texel."""

    uvs: NDArray[np.float64]
    faces: NDArray[np.int32]

    @staticmethod
    def of(vehicle: Vehicle, size: int) -> Facets:
        uvs = vehicle.uvs[vehicle.paint_faces()].astype(np.float64)
        return Facets(uvs, texel_faces(uvs, size))


def fill(uv_map: Tensor, facets: Facets) -> Tensor:
    """A linear map (size, size, 3) -> all cells of T_fc (nf * ts ** 3, 3); differentiable."""
    cells: Tensor = _Fill.apply(uv_map, facets)
    return cells


class _Fill(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, uv_map: Tensor, facets: Facets) -> Tensor:
        cells, total = uv_traversal_step(uv_map.detach().numpy(), facets.uvs, facets.faces, TEXTURE_SIZE)
        ctx.facets, ctx.total = facets, total
        return torch.from_numpy(cells).reshape(-1, 3)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        given = gradients[0].contiguous().numpy().reshape(*ctx.total.shape, 3)
        return torch.from_numpy(uv_traversal_step_back(given, ctx.total, *ctx.facets)), None


def pixels_from_cells(vehicle: Vehicle, camera: Camera) -> tuple[NDArray[np.int64], SparseOperator]:
    """The painted pixels (R,) of a view, and how they read T_fc: eight cells per subsample, averaged over the pixel."""
    paint = vehicle.paint_faces()
    raster = rasterize(vehicle.positions, vehicle.triangles, camera, pattern=pattern(SUBSAMPLES, "grid"))
    found = facet_fragments(vehicle, find_surface(raster, paint), TEXTURE_SIZE, np.cumsum(paint) - 1)
    y, x = np.nonzero(found.index >= 0)
    pixels = (y + raster.y0) // SUBSAMPLES * camera.width + (x + raster.x0) // SUBSAMPLES
    names, row_of = np.unique(pixels, return_inverse=True)
    n = found.index[y, x]
    weights = found.weights[n] * found.paint[n, None] / SUBSAMPLES**2
    cells = found.texels[n]
    count = int(paint.sum()) * TEXTURE_SIZE**3
    rows = np.repeat(row_of, cells.shape[1])
    return names, from_triplets(rows, cells.ravel(), weights.ravel(), (len(names), count))


def texel_faces(uvs: NDArray[np.floating], size: int) -> NDArray[np.int32]:
    """Face (size, size) int32 under each texel's center, row 0 at the top, or -1; the lowest where charts overlap."""
    return rasterize_atlas(uvs, size).whole(size, size)


@njit(cache=True, nogil=True)
def uv_traversal_step(uv_map: Any, uvs: Any, faces: Any, ts: int) -> Any:
    """Algorithm 2: a map (size, size, 3) -> T_fc (nf, ts, ts, ts, 3) and W (nf, ts, ts, ts), both of its type.

    ``faces`` is :func:`texel_faces`. Cells of no weight stay black.
    """
    size = uv_map.shape[0]
    cells = np.zeros((uvs.shape[0], ts, ts, ts, 3), uv_map.dtype)
    total = np.zeros((uvs.shape[0], ts, ts, ts), uv_map.dtype)
    for row in range(size):
        for column in range(size):
            m = faces[row, column]
            if m < 0:
                continue
            a, b, c = _cell_coordinates(uvs[m], (column + 0.5) / size, 1 - (row + 0.5) / size, ts)
            for i in range(8):
                x, y, z, w = _cell(a, b, c, i, ts)
                total[m, x, y, z] += w
                for k in range(3):
                    cells[m, x, y, z, k] += w * uv_map[row, column, k]
    for m in range(uvs.shape[0]):
        for x in range(ts):
            for y in range(ts):
                for z in range(ts):
                    if total[m, x, y, z] > 0:
                        for k in range(3):
                            cells[m, x, y, z, k] /= total[m, x, y, z]
    return cells, total


@njit(cache=True, nogil=True)
def uv_traversal_step_back(gradient: Any, total: Any, uvs: Any, faces: Any) -> Any:
    """Gradient (nf, ts, ts, ts, 3) on T_fc, and W of the forward step -> gradient (size, size, 3) on the map."""
    size, ts = faces.shape[0], gradient.shape[1]
    result = np.zeros((size, size, 3), gradient.dtype)
    for row in range(size):
        for column in range(size):
            m = faces[row, column]
            if m < 0:
                continue
            a, b, c = _cell_coordinates(uvs[m], (column + 0.5) / size, 1 - (row + 0.5) / size, ts)
            for i in range(8):
                x, y, z, w = _cell(a, b, c, i, ts)
                if w > 0:
                    for k in range(3):
                        result[row, column, k] += w / total[m, x, y, z] * gradient[m, x, y, z, k]
    return result


@njit(cache=True, nogil=True)
def _cell_coordinates(uv: Any, u: float, v: float, ts: int) -> Any:
    """Barycentrics of (u, v) in a UV triangle of either winding, times ts - 1."""
    bu, bv, cu, cv = uv[1, 0] - uv[0, 0], uv[1, 1] - uv[0, 1], uv[2, 0] - uv[0, 0], uv[2, 1] - uv[0, 1]
    pu, pv, area = u - uv[0, 0], v - uv[0, 1], bu * cv - bv * cu
    # A texel that the face owns may lie outside it by the rounding of the rasterizer.
    b, c = max((pu * cv - pv * cu) / area, 0.0), max((bu * pv - bv * pu) / area, 0.0)
    a = max(1 - b - c, 0.0)
    scale = (ts - 1) / (a + b + c)
    return a * scale, b * scale, c * scale


@njit(cache=True, nogil=True)
def _cell(a: float, b: float, c: float, i: int, ts: int) -> Any:
    """The i-th of eight cells around (a, b, c), and its weight."""
    x, y, z = min(int(a), ts - 2), min(int(b), ts - 2), min(int(c), ts - 2)
    i, j, k = i // 4, i // 2 % 2, i % 2
    w = (a - x if i else 1 - (a - x)) * (b - y if j else 1 - (b - y)) * (c - z if k else 1 - (c - z))
    return x + i, y + j, z + k, w
