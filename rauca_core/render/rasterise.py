"""Which face owns each subsample of an image: a scanline z-buffer that is exact about edges.

Vertices and samples are snapped to one fixed-point lattice and edges follow the top-left rule, so a sample on a shared
edge belongs to exactly one face. Depth and barycentrics come from the unsnapped triangle in homogeneous coordinates,
float64: float32 depth could not separate surfaces a micrometre apart at ten metres.
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
from .pattern import Pattern
from .pattern import pattern as pattern_of

Array = NDArray[np.float64]

NEAR_M = 0.02  # the near plane of the cameras that Blender renders with
FRACTION = 16  # bits of a pixel that vertices and samples are snapped to, whatever the pattern
ONE, HALF = 1 << FRACTION, 1 << (FRACTION - 1)
# Coordinates span MAX_SIDE + 2 * GUARD = 24,576 px, 31 bits in fixed point. An edge function is the sum of two
# products of such differences: 63 bits at most. Times the columns of a pixel it only ever stands for a position.
MAX_SIDE = 2**14
GUARD = 2.0**12
DEPTH_TIE = 1e-9  # relative; coplanar duplicates differ by rounding only, and the lowest face id must win


@dataclass(frozen=True, eq=False)
class Raster:
    """Visibility of a mesh at the subsamples of an image.

    Sample (row r, column c) of the window lies at pixel coordinates
    ``x = (x0 + c + shifts[(y0 + r) % rows]) / columns - margin`` and ``y = (y0 + r + 0.5) / rows - margin``.

    Attributes:
        face_ids: (h, w) int32 face seen by each sample of the window, -1 for none.
        x0, y0: the window's first column and row in the image's samples, margin included.
        pattern: where the samples of a pixel lie: ``columns``, ``rows`` and ``shifts``.
        margin: pixels rasterised around the image.
        planes: (F, 3, 3) float64; ``(x, y, 1) @ planes[face]`` at pixel coordinates (x, y) is barycentrics / depth.
    """

    face_ids: NDArray[np.int32]
    x0: int
    y0: int
    pattern: Pattern
    margin: int
    planes: Array

    def points(self, rows: NDArray[np.integer], columns: NDArray[np.integer]) -> Array:
        """Pixel coordinates (N, 2) of the samples at ``rows`` (N,) and ``columns`` (N,) of the window."""
        pattern, rows = self.pattern, rows + self.y0
        x = (columns + self.x0 + pattern.shifts[rows % pattern.rows]) / pattern.columns - self.margin
        return np.stack([x, (rows + 0.5) / pattern.rows - self.margin], 1)

    def barycentrics(self) -> Array:
        """Perspective-correct barycentrics (h, w, 3) float64 of every sample; zeros where nothing is seen."""
        result = np.zeros((*self.face_ids.shape, 3))
        rows, columns = np.nonzero(self.face_ids >= 0)
        planes = self.planes[self.face_ids[rows, columns]]
        points = np.pad(self.points(rows, columns), ((0, 0), (0, 1)), constant_values=1.0)
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
    *,
    pattern: Pattern | None = None,
) -> Raster:
    """Find the nearest face behind every subsample. Both sides of a face are seen, as in Cycles.

    Args:
        positions: (V, 3) vertices in the camera's world, metres. Faces of NaN or infinite vertices are left out, with
            a warning that counts the vertices.
        triangles: (F, 3) vertex indices. Faces without area draw nothing.
        camera: OpenCV pinhole.
        samples: a pixel has ``samples`` x ``samples`` subsamples, placed by :func:`pattern.pattern`.
        margin: pixels around the image to rasterise as well (the pixel filter reaches beyond its edge).
        near: faces nearer than this, metres along z, are cut off.
        pattern: where the subsamples lie, in place of ``samples``.

    Raises:
        RaucaError: samples outside 1 to 16, or an image of more than 16384 pixels along a side, margin included.
    """
    pattern = pattern or pattern_of(samples)
    width, height = camera.width + 2 * margin, camera.height + 2 * margin
    if max(width, height) > MAX_SIDE:
        raise RaucaError(f"camera: {width}x{height} pixels are too many to rasterise; choose at most {MAX_SIDE} a side")
    finite = np.isfinite(positions).all(axis=1)
    triangles = np.ascontiguousarray(triangles, np.int32)
    if not finite.all():
        warnings.warn(
            f"mesh: {int((~finite).sum())} vertices are NaN or infinite; their faces are left out", stacklevel=2
        )
    keep = finite[triangles].all(axis=1)
    local = np.where(finite[:, None], positions, 0.0).astype(np.float64) @ camera.R.T + camera.t
    points = np.ascontiguousarray(local @ camera.K.T)
    planes = clip_planes(camera.width, camera.height, GUARD + margin)
    low_x, low_y, high_x, high_y = _bounds(points, triangles, keep, planes, near)
    x0, x1 = _window(low_x + margin, high_x + margin, pattern.columns, width)
    y0, y1 = _window(low_y + margin, high_y + margin, pattern.rows, height)
    face_ids = np.full((y1 - y0, x1 - x0), -1, np.int32)
    attributes = np.zeros((len(triangles), 3, 3))
    if face_ids.size:
        origin = x0 - margin * pattern.columns, y0 - margin * pattern.rows
        shifts = np.rint(pattern.shifts * ONE).astype(np.int64)
        nearest = np.zeros(face_ids.shape)
        _rasterise(
            points, triangles, keep, planes, near, *origin, pattern.columns, shifts, face_ids, nearest, attributes
        )
    return Raster(face_ids, x0, y0, pattern, margin, attributes)


def _window(low: float, high: float, per_pixel: int, pixels: int) -> tuple[int, int]:
    """First and one past the last of the samples between two coordinates, pixels from the margin's edge."""
    if low > high:
        return 0, 0
    first, last = np.floor(low * per_pixel) - 1, np.floor(high * per_pixel) + 2
    limit = pixels * per_pixel
    start = int(min(max(first, 0), limit))
    return start, int(min(max(last, start), limit))


@njit(cache=True)
def _bounds(
    points: Array, triangles: NDArray[np.int32], keep: NDArray[np.bool_], planes: Array, near: float
) -> tuple[float, float, float, float]:
    """The smallest and largest pixel coordinates of the clipped mesh: x, y, x, y."""
    corners, polygon, spare = np.empty((3, 3)), np.empty((MAX_CORNERS, 3)), np.empty((MAX_CORNERS, 3))
    x0, y0, x1, y1 = np.inf, np.inf, -np.inf, -np.inf
    for f in range(triangles.shape[0]):
        if not keep[f]:
            continue
        for k in range(3):
            corners[k] = points[triangles[f, k]]
        for k in range(clip_face(corners, planes, near, polygon, spare)):
            x, y = polygon[k, 0] / polygon[k, 2], polygon[k, 1] / polygon[k, 2]
            x0, x1, y0, y1 = min(x0, x), max(x1, x), min(y0, y), max(y1, y)
    return x0, y0, x1, y1


@njit(cache=True)
def _rasterise(
    points: Array,
    triangles: NDArray[np.int32],
    keep: NDArray[np.bool_],
    planes: Array,
    near: float,
    x0: int,
    y0: int,
    columns: int,
    shifts: NDArray[np.int64],
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
            fixed[k, 0] = np.int64(np.rint(polygon[k, 0] * inverse * ONE))
            fixed[k, 1] = np.int64(np.rint(polygon[k, 1] * inverse * ONE))
        for k in range(1, count - 1):
            _fill(fixed, k, attributes[f], low, high, f, x0, y0, columns, shifts, face_ids, nearest)


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
    columns: int,
    shifts: NDArray[np.int64],
    face_ids: NDArray[np.int32],
    nearest: Array,
) -> None:
    """Draw triangle (0, k, k + 1) of a clipped polygon; ``low`` and ``high`` bound 1 / depth on it.

    Rows and columns count from the image's corner. Row r lies at fixed-point (r * ONE + ONE / 2) // rows, column c of
    it at (c * ONE + shift) // columns.
    """
    rows = shifts.shape[0]
    ax, ay, bx, by, cx, cy = fixed[0, 0], fixed[0, 1], fixed[k, 0], fixed[k, 1], fixed[k + 1, 0], fixed[k + 1, 1]
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if area == 0:
        return
    if area < 0:
        bx, by, cx, cy = cx, cy, bx, by
    dx = plane[0, 0] + plane[0, 1] + plane[0, 2]
    dy = plane[1, 0] + plane[1, 1] + plane[1, 2]
    d1 = plane[2, 0] + plane[2, 1] + plane[2, 2]
    first = max(y0, _first(min(ay, by, cy), rows, HALF))
    last = min(y0 + face_ids.shape[0] - 1, _last(max(ay, by, cy), rows, HALF))
    leftmost, rightmost = min(ax, bx, cx), max(ax, bx, cx)
    for r in range(first, last + 1):
        y, shift = (r * ONE + HALF) // rows, shifts[r % rows]
        left, right = _narrow(ax, ay, bx, by, y, leftmost, rightmost)
        left, right = _narrow(bx, by, cx, cy, y, left, right)
        left, right = _narrow(cx, cy, ax, ay, y, left, right)
        begin, end = (
            max(x0, _first(left, columns, shift)),
            min(x0 + face_ids.shape[1] - 1, _last(right, columns, shift)),
        )
        fraction = shift / ONE
        row_depth = dy * ((r + 0.5) / rows) + d1
        for c in range(begin, end + 1):
            inverse_depth = min(max(dx * ((c + fraction) / columns) + row_depth, low), high)
            if inverse_depth > nearest[r - y0, c - x0] * (1.0 + DEPTH_TIE):
                nearest[r - y0, c - x0] = inverse_depth
                face_ids[r - y0, c - x0] = face


@njit(cache=True)
def _first(position: Any, per_pixel: Any, offset: Any) -> Any:
    """The first sample at or after a fixed-point position, where sample n lies at (n * ONE + offset) // per_pixel."""
    return -((offset - position * per_pixel) // ONE)


@njit(cache=True)
def _last(position: Any, per_pixel: Any, offset: Any) -> Any:
    """The last sample at or before a fixed-point position."""
    return ((position + 1) * per_pixel - 1 - offset) // ONE


@njit(cache=True)
def _narrow(ax: Any, ay: Any, bx: Any, by: Any, y: Any, left: Any, right: Any) -> Any:
    """Narrow a row's positions [left, right] to the inner side of edge a -> b: top and left edges own their samples."""
    dx, dy = bx - ax, by - ay
    owns = dy < 0 or (dy == 0 and dx > 0)
    level = dx * (y - ay) + dy * ax - (0 if owns else 1)  # inside where level - dy * x >= 0
    if dy > 0:
        right = min(right, level // dy)
    elif dy < 0:
        left = max(left, -(level // -dy))
    elif level < 0:
        right = left - 1
    return left, right
