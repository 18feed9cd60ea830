"""Which face owns each subsample of an image: a scanline z-buffer that is exact about edges.

Vertices are snapped to fixed-point numbers and edges follow the top-left rule, so a sample on a shared edge belongs to
exactly one face. Depth and barycentrics come from the unsnapped triangle in homogeneous coordinates, float64: float32
depth could not separate surfaces a micrometre apart at ten metres.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..contract import Camera, RaucaError
from .clip import MAX_CORNERS, clip_face, clip_planes

Array = NDArray[np.float64]

NEAR_M = 0.02  # the near plane of the cameras that Blender renders with
FRACTION = 12  # bits of a sample's width that vertices are snapped to
GUARD = float(2**14)
MAX_GRID = 2**16  # with FRACTION and GUARD this keeps edge functions within 62 bits
DEPTH_TIE = 1e-9  # relative; coplanar duplicates differ by rounding only, and the lowest face id must win


@dataclass(frozen=True, eq=False)
class Raster:
    """Visibility of a mesh on a regular grid of subsamples.

    Sample (row, column) of the window lies at image position ``((x0 + column + 0.5) / samples - margin)`` pixels
    along x, and alike along y.

    Attributes:
        face_ids: (h, w) int32 face seen by each sample of the window, -1 for none.
        x0, y0: the window's first column and row in the grid of ``samples * (size + 2 * margin)`` samples.
        samples: subsamples per pixel along each axis.
        margin: pixels rasterised around the image.
        planes: (F, 3, 3) float64; ``(x, y, 1) @ planes[face]`` at grid coordinates (x, y) is barycentrics / depth.
    """

    face_ids: NDArray[np.int32]
    x0: int
    y0: int
    samples: int
    margin: int
    planes: Array

    def barycentrics(self) -> Array:
        """Perspective-correct barycentrics (h, w, 3) float64 of every sample; zeros where nothing is seen."""
        result = np.zeros((*self.face_ids.shape, 3))
        rows, columns = np.nonzero(self.face_ids >= 0)
        planes = self.planes[self.face_ids[rows, columns]]
        points = np.stack([columns + self.x0, rows + self.y0, np.ones_like(rows)], 1).astype(float)
        over_depth = np.maximum(np.einsum("ni,nij->nj", points, planes), 0.0)
        result[rows, columns] = over_depth / np.maximum(over_depth.sum(1, keepdims=True), 1e-300)
        return result


def rasterize(
    positions: NDArray[np.floating],
    triangles: NDArray[np.int32],
    camera: Camera,
    samples: int = 1,
    margin: int = 0,
    near: float = NEAR_M,
) -> Raster:
    """Find the nearest face behind every subsample. Both sides of a face are seen, as in Cycles.

    Args:
        positions: (V, 3) vertices in the camera's world, metres. Faces of NaN or infinite vertices are left out, with
            a warning that counts the vertices.
        triangles: (F, 3) vertex indices. Faces without area draw nothing.
        camera: OpenCV pinhole.
        samples: subsamples per pixel along each axis.
        margin: pixels around the image to rasterise as well (the pixel filter reaches beyond its edge).
        near: faces nearer than this, metres along z, are cut off.

    Raises:
        RaucaError: the grid of samples is larger than 65536 along an axis.
    """
    columns, rows = samples * (camera.width + 2 * margin), samples * (camera.height + 2 * margin)
    if samples < 1 or max(columns, rows) > MAX_GRID:
        raise RaucaError(
            f"samples: {samples} per pixel makes a grid of {columns}x{rows}; choose 1 to {MAX_GRID} in all"
        )
    finite = np.isfinite(positions).all(axis=1)
    triangles = np.ascontiguousarray(triangles, np.int32)
    if not finite.all():
        warnings.warn(
            f"mesh: {int((~finite).sum())} vertices are NaN or infinite; their faces are left out", stacklevel=2
        )
    keep = finite[triangles].all(axis=1)
    local = np.where(finite[:, None], positions, 0.0).astype(np.float64) @ camera.R.T + camera.t
    homogeneous = local @ camera.K.T
    grid = np.array([[samples, 0, samples * margin - 0.5], [0, samples, samples * margin - 0.5], [0, 0, 1.0]])
    points = np.ascontiguousarray(homogeneous @ grid.T)
    planes = clip_planes(columns, rows, GUARD)
    x0, y0, x1, y1 = _window(points, triangles, keep, planes, near, columns, rows)
    face_ids = np.full((max(0, y1 - y0), max(0, x1 - x0)), -1, np.int32)
    attributes = np.zeros((len(triangles), 3, 3))
    if face_ids.size:
        nearest = np.zeros(face_ids.shape)
        _rasterise(points, triangles, keep, planes, near, x0, y0, face_ids, nearest, attributes)
    return Raster(face_ids, x0, y0, samples, margin, attributes)


@njit(cache=True)
def _window(
    points: Array,
    triangles: NDArray[np.int32],
    keep: NDArray[np.bool_],
    planes: Array,
    near: float,
    columns: int,
    rows: int,
) -> tuple[int, int, int, int]:
    """The samples that the clipped mesh can touch: x0, y0 inclusive, x1, y1 exclusive."""
    corners, polygon, spare = np.empty((3, 3)), np.empty((MAX_CORNERS, 3)), np.empty((MAX_CORNERS, 3))
    x0, y0, x1, y1 = float(columns), float(rows), -1.0, -1.0
    for f in range(triangles.shape[0]):
        if not keep[f]:
            continue
        for k in range(3):
            corners[k] = points[triangles[f, k]]
        for k in range(clip_face(corners, planes, near, polygon, spare)):
            x, y = polygon[k, 0] / polygon[k, 2], polygon[k, 1] / polygon[k, 2]
            x0, x1, y0, y1 = min(x0, x), max(x1, x), min(y0, y), max(y1, y)
    return (
        max(0, int(np.floor(x0))),
        max(0, int(np.floor(y0))),
        min(columns, int(np.floor(x1)) + 2),
        min(rows, int(np.floor(y1)) + 2),
    )


@njit(cache=True)
def _rasterise(
    points: Array,
    triangles: NDArray[np.int32],
    keep: NDArray[np.bool_],
    planes: Array,
    near: float,
    x0: int,
    y0: int,
    face_ids: NDArray[np.int32],
    nearest: Array,
    attributes: Array,
) -> None:
    corners, polygon, spare = np.empty((3, 3)), np.empty((MAX_CORNERS, 3)), np.empty((MAX_CORNERS, 3))
    fixed = np.empty((MAX_CORNERS, 2), np.int64)
    for f in range(triangles.shape[0]):
        if not keep[f]:
            continue
        for k in range(3):
            corners[k] = points[triangles[f, k]]
        if not _invert(corners, attributes[f]):
            continue
        count = clip_face(corners, planes, near, polygon, spare)
        low, high = np.inf, 0.0
        for k in range(count):
            inverse = 1.0 / polygon[k, 2]
            low, high = min(low, inverse), max(high, inverse)
            fixed[k, 0] = np.int64(np.rint(polygon[k, 0] * inverse * (1 << FRACTION)))
            fixed[k, 1] = np.int64(np.rint(polygon[k, 1] * inverse * (1 << FRACTION)))
        for k in range(1, count - 1):
            _fill(fixed, k, attributes[f], low, high, f, x0, y0, face_ids, nearest)


@njit(cache=True)
def _invert(corners: Array, inverse: Array) -> bool:
    """Invert the homogeneous triangle (rows are corners); False for a face seen edge-on or without area."""
    for k in range(3):
        a, b = corners[(k + 1) % 3], corners[(k + 2) % 3]
        inverse[0, k] = a[1] * b[2] - a[2] * b[1]
        inverse[1, k] = a[2] * b[0] - a[0] * b[2]
        inverse[2, k] = a[0] * b[1] - a[1] * b[0]
    determinant = corners[0, 0] * inverse[0, 0] + corners[0, 1] * inverse[1, 0] + corners[0, 2] * inverse[2, 0]
    if determinant == 0.0 or not np.isfinite(1.0 / determinant):
        return False
    for i in range(3):
        for k in range(3):
            inverse[i, k] /= determinant
    return True


@njit(cache=True)
def _fill(
    fixed: NDArray[np.int64],
    k: int,
    plane: Array,
    low: float,
    high: float,
    face: int,
    x0: int,
    y0: int,
    face_ids: NDArray[np.int32],
    nearest: Array,
) -> None:
    """Draw triangle (0, k, k + 1) of a clipped polygon; ``low`` and ``high`` bound 1 / depth on it."""
    one = np.int64(1) << FRACTION
    ax, ay, bx, by, cx, cy = fixed[0, 0], fixed[0, 1], fixed[k, 0], fixed[k, 1], fixed[k + 1, 0], fixed[k + 1, 1]
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if area == 0:
        return
    if area < 0:
        bx, by, cx, cy = cx, cy, bx, by
    dx = plane[0, 0] + plane[0, 1] + plane[0, 2]
    dy = plane[1, 0] + plane[1, 1] + plane[1, 2]
    d1 = plane[2, 0] + plane[2, 1] + plane[2, 2]
    first = max(y0, -(-min(ay, by, cy) // one))
    last = min(y0 + face_ids.shape[0] - 1, max(ay, by, cy) // one)
    for y in range(first, last + 1):
        left, right = x0, x0 + face_ids.shape[1] - 1
        left, right = _narrow(ax, ay, bx, by, y * one, left, right)
        left, right = _narrow(bx, by, cx, cy, y * one, left, right)
        left, right = _narrow(cx, cy, ax, ay, y * one, left, right)
        for x in range(left, right + 1):
            inverse_depth = min(max(dx * x + dy * y + d1, low), high)
            if inverse_depth > nearest[y - y0, x - x0] * (1.0 + DEPTH_TIE):
                nearest[y - y0, x - x0] = inverse_depth
                face_ids[y - y0, x - x0] = face


@njit(cache=True)
def _narrow(ax: Any, ay: Any, bx: Any, by: Any, y: Any, left: Any, right: Any) -> Any:
    """Narrow a row's samples [left, right] to the inner side of edge a -> b: top and left edges own their samples."""
    one = np.int64(1) << FRACTION
    dx, dy = bx - ax, by - ay
    owns = dy < 0 or (dy == 0 and dx > 0)
    level = dx * (y - ay) + dy * ax - (0 if owns else 1)  # inside where level - dy * x >= 0
    if dy > 0:
        right = min(right, level // (dy * one))
    elif dy < 0:
        left = max(left, -(level // (-dy * one)))
    elif level < 0:
        right = left - 1
    return left, right
