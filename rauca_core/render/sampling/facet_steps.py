"""Algorithms 1 and 2 worked out anew at every step, as the published renderer does.

`facets` turns both into operators once, since they depend on geometry only. These kernels exist to measure what that
saves: the benchmark times them, forward and backward, against our taps. They compute the same numbers (tested), and are
kinder than the original, which also finds the face of every texel again at each step; here that map is given.
All loops are serial, so that sums repeat to the bit. ``uvs`` is (nf, 3, 2) float64 throughout.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..kernels import njit
from ..raster.atlas import rasterize_atlas


def texel_faces(uvs: NDArray[np.floating], size: int) -> NDArray[np.int32]:
    """Face (size, size) int32 under each texel's center, row 0 at the top, or -1; the lowest where charts overlap."""
    return rasterize_atlas(uvs, size).whole(size, size)


@njit(cache=True, nogil=True)
def tensor_traversal_step(uv_map: Any, uvs: Any, ts: int) -> Any:
    """Algorithm 1: a map (size, size, 3), row 0 at the top, -> T_fc (nf, ts, ts, ts, 3) of its type."""
    size = uv_map.shape[0]
    cells = np.zeros((uvs.shape[0], ts, ts, ts, 3), uv_map.dtype)
    for m in range(uvs.shape[0]):
        for x in range(ts):
            for y in range(ts):
                for z in range(ts):
                    a, b = _project(uvs[m], x, y, z, size)
                    for i in range(4):
                        column, row, w = _neighbor(a, b, i, size)
                        for c in range(3):
                            cells[m, x, y, z, c] += w * uv_map[row, column, c]
    return cells


@njit(cache=True, nogil=True)
def tensor_traversal_step_back(gradient: Any, uvs: Any, size: int) -> Any:
    """Gradient (nf, ts, ts, ts, 3) on T_fc -> gradient (size, size, 3) on the map."""
    ts = gradient.shape[1]
    result = np.zeros((size, size, 3), gradient.dtype)
    for m in range(uvs.shape[0]):
        for x in range(ts):
            for y in range(ts):
                for z in range(ts):
                    a, b = _project(uvs[m], x, y, z, size)
                    for i in range(4):
                        column, row, w = _neighbor(a, b, i, size)
                        for c in range(3):
                            result[row, column, c] += w * gradient[m, x, y, z, c]
    return result


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
def _project(uv: Any, x: int, y: int, z: int, size: int) -> Any:
    """Where cell (x, y, z) falls on the map: column and row, clamped to it."""
    total = max(x + y + z, 1)
    u = (x * uv[0, 0] + y * uv[1, 0] + z * uv[2, 0]) / total
    v = (x * uv[0, 1] + y * uv[1, 1] + z * uv[2, 1]) / total
    return min(max(u * size - 0.5, 0.0), size - 1.0), min(max((1 - v) * size - 0.5, 0.0), size - 1.0)


@njit(cache=True, nogil=True)
def _neighbor(a: float, b: float, i: int, size: int) -> Any:
    """Column, row and weight of the i-th of four texels around (a, b)."""
    left, top = int(a), int(b)
    w = (a - left if i % 2 else 1 - (a - left)) * (b - top if i // 2 else 1 - (b - top))
    return min(left + i % 2, size - 1), min(top + i // 2, size - 1), w


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
