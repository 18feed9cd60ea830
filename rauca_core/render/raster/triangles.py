"""From a mesh to triangles in fixed point: the screen, its vertices, and clipping at the camera and far off the image.

Vertices and samples lie on one lattice of 1/65536 pixel, whatever the pattern: 31 bits hold the image and a guard band
around it, and an edge function, the sum of two products of differences, fits into 63. Clipping comes before any
division, in homogeneous pixel coordinates: a camera may stand inside the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...contract import Camera
from ...runtime.kernels import njit
from .pattern import Pattern

FRACTION = 16
ONE, HALF = 1 << FRACTION, 1 << (FRACTION - 1)
MAX_SIDE = 2**14  # pixels of an image, margin included
GUARD = 2.0**12  # pixels around it: MAX_SIDE + 2 * GUARD < 2^15, and twice the square of 2^15 * ONE is 2^63
DEPTH_TIE = 1.0 + 1e-9  # coplanar duplicates differ by rounding only, and the lowest face id must win
LIMIT = 1e30  # beyond it, products of three homogeneous coordinates could overflow

MAX_CORNERS = 9  # a triangle gains at most one corner per plane: 3 + 5, and one to spare

INSIDE, OUTSIDE, BROKEN = 0, 1, 2  # of the clip planes; broken is NaN, infinite or beyond LIMIT

Window = tuple[int, int, int, int]  # x0, y0 inclusive, x1, y1 exclusive, in samples from the image's corner


@dataclass(frozen=True, eq=False)
class Screen:
    """An image and its samples in fixed point.

    Row r of samples lies at ``y = (r * ONE + HALF) // rows`` and column c of it at
    ``x = (c * ONE + shifts[r % rows]) // columns``, counted from the image's corner: negative in the margin.

    Attributes:
        matrix: (3, 4) float64, from the world to homogeneous pixel coordinates.
        planes: (5, 3) float64 on homogeneous pixel coordinates (X, Y, w); ``plane @ point >= 0`` is kept. The first is
            w = 0, which becomes the near plane when its depth is taken off; the others are a guard band.
        near: metres.
        columns, rows: samples of a pixel along x, and rows of samples along y.
        shifts: (rows,) int64, of a column's width.
        limits: the whole image, margin included.
    """

    matrix: NDArray[np.float64]
    planes: NDArray[np.float64]
    near: float
    columns: int
    rows: int
    shifts: NDArray[np.int64]
    limits: Window

    @staticmethod
    def of(camera: Camera, pattern: Pattern, margin: int, near: float) -> Screen:
        matrix = camera.K @ np.column_stack([camera.R, camera.t])
        across, down = margin * pattern.columns, margin * pattern.rows
        limits = (-across, -down, camera.width * pattern.columns + across, camera.height * pattern.rows + down)
        guard = GUARD + margin  # pixels outside the image, so that vertices at any distance fit into fixed point
        right, bottom = camera.width + guard, camera.height + guard
        planes = np.array([[0, 0, 1], [1, 0, guard], [-1, 0, right], [0, 1, guard], [0, -1, bottom]], np.float64)
        shifts = np.rint(pattern.shifts * ONE).astype(np.int64)
        return Screen(matrix, planes, near, pattern.columns, pattern.rows, shifts, limits)

    def lines(self, window: Window) -> tuple[NDArray[Any], ...]:
        """Of each row (h,) of a window: its y and its columns' shift in fixed point; both in pixels, float64."""
        r = np.arange(window[1], window[3])
        shifts = self.shifts[r % self.rows]
        return (r * ONE + HALF) // self.rows, shifts, shifts / (ONE * self.columns), (r + 0.5) / self.rows


class Vertices(NamedTuple):
    """V vertices as the rasterizer sees them.

    Attributes:
        points: (3, V) float64 homogeneous pixel coordinates.
        over: (V,) float64 1 / depth, 0 unless inside.
        fixed: (2, V) int32 x and y in fixed point; 0 unless inside.
        state: (V,) uint8, INSIDE, OUTSIDE or BROKEN.
    """

    points: NDArray[np.float64]
    over: NDArray[np.float64]
    fixed: NDArray[np.int32]
    state: NDArray[np.uint8]


def project(positions: NDArray[np.floating], screen: Screen) -> Vertices:
    """Project positions (V, 3), in short loops without a branch: the compiler makes vectors of them."""
    number = len(positions)
    points, fixed = np.empty((3, number)), np.empty((2, number), np.int32)
    over, state = np.empty(number), np.empty(number, np.uint8)
    _transform(positions, screen.matrix, points)
    _classify(points, screen.planes, screen.near, over, state)
    _snap(points, over, fixed)
    return Vertices(points, over, fixed, state)


@njit(cache=True, nogil=True, error_model="numpy")
def _transform(positions: Any, matrix: Any, points: Any) -> None:
    for row in range(3):
        a, b, c, d = matrix[row, 0], matrix[row, 1], matrix[row, 2], matrix[row, 3]
        line = points[row]
        for v in range(positions.shape[0]):
            line[v] = a * positions[v, 0] + b * positions[v, 1] + c * positions[v, 2] + d


@njit(cache=True, nogil=True, error_model="numpy")
def _classify(points: Any, planes: Any, near: float, over: Any, state: Any) -> None:
    left, right, top, bottom = planes[1, 2], planes[2, 2], planes[3, 2], planes[4, 2]
    xs, ys, ws = points[0], points[1], points[2]
    for v in range(over.shape[0]):
        x, y, w = xs[v], ys[v], ws[v]
        whole = (abs(x) <= LIMIT) & (abs(y) <= LIMIT) & (abs(w) <= LIMIT)
        across = (x + left * w >= 0.0) & (right * w - x >= 0.0)
        inside = whole & (w >= near) & across & (y + top * w >= 0.0) & (bottom * w - y >= 0.0)
        over[v] = 1.0 / w if inside else 0.0
        state[v] = INSIDE if inside else (OUTSIDE if whole else BROKEN)


@njit(cache=True, nogil=True, error_model="numpy")
def _snap(points: Any, over: Any, fixed: Any) -> None:
    for axis in range(2):
        line, places = points[axis], fixed[axis]
        for v in range(over.shape[0]):
            place = np.rint(line[v] * over[v] * ONE)
            places[v] = np.int32(place if abs(place) <= LIMIT else 0.0)  # broken: not a number


@njit(cache=True, nogil=True, error_model="numpy")
def clip_faces(points: Any, over: Any, fixed: Any, state: Any, triangles: Any, planes: Any, near: float) -> Any:
    """Replace faces across the clip planes by fans of new corners; faces of broken vertices, by nothing.

    Args:
        points, over, fixed, state: of the vertices, see `Vertices`.
        triangles: (F, 3) vertex indices.
        planes, near: see `Screen`.

    Returns:
        corners (T, 3) int32 and owners (T,) int32 of the triangles to draw, by ascending face; over and fixed, with
        the new corners appended.
    """
    across = 0
    for f in range(triangles.shape[0]):
        across += (state[triangles[f, 0]] | state[triangles[f, 1]] | state[triangles[f, 2]]) == OUTSIDE
    corners = np.empty((triangles.shape[0] + across * MAX_CORNERS, 3), np.int32)
    owners = np.empty(len(corners), np.int32)
    vertices = len(over)
    over = np.concatenate((over, np.empty(across * MAX_CORNERS)))
    fixed = np.concatenate((fixed, np.empty((2, across * MAX_CORNERS), np.int32)), 1)
    polygon, spare = np.empty((MAX_CORNERS, 3)), np.empty((MAX_CORNERS, 3))
    drawn = 0
    for f in range(triangles.shape[0]):
        i, j, k = triangles[f, 0], triangles[f, 1], triangles[f, 2]
        where = state[i] | state[j] | state[k]
        if where == INSIDE:
            corners[drawn, 0], corners[drawn, 1], corners[drawn, 2], owners[drawn] = i, j, k, f
            drawn += 1
        elif where == OUTSIDE:
            for axis in range(3):
                polygon[0, axis], polygon[1, axis], polygon[2, axis] = points[axis, i], points[axis, j], points[axis, k]
            count = _clip(planes, near, polygon, spare)
            for n in range(count):
                inverse = 1.0 / max(polygon[n, 2], near)
                over[vertices + n] = inverse
                for axis in range(2):  # rounding may leave a corner a little outside
                    low, high = -planes[1 + 2 * axis, 2], planes[2 + 2 * axis, 2]
                    place = min(max(polygon[n, axis] * inverse, low), high)
                    fixed[axis, vertices + n] = np.int32(np.rint(place * ONE))
            for n in range(1, count - 1):
                corners[drawn, 0], corners[drawn, 1], corners[drawn, 2] = vertices, vertices + n, vertices + n + 1
                owners[drawn] = f
                drawn += 1
            vertices += count
    return corners[:drawn], owners[:drawn], over[:vertices], fixed[:, :vertices].copy()


@njit(cache=True, nogil=True, error_model="numpy")
def _clip(planes: Any, near: float, polygon: Any, spare: Any) -> int:
    """Sutherland-Hodgman: clip the triangle in ``polygon`` in place; returns the corner count.

    An intersection is always computed from the end nearer to the plane, so two faces that share an edge clip it to the
    same bits and stay watertight, and one that ends a light year away still meets the plane.
    """
    count = 3
    for p in range(planes.shape[0]):
        offset = near if p == 0 else 0.0
        kept = 0
        for i in range(count):
            here, there = polygon[i], polygon[(i + 1) % count]
            d_here = planes[p, 0] * here[0] + planes[p, 1] * here[1] + planes[p, 2] * here[2] - offset
            d_there = planes[p, 0] * there[0] + planes[p, 1] * there[1] + planes[p, 2] * there[2] - offset
            if d_here >= 0.0:
                for axis in range(3):  # whole rows at once would take numba ten times as long to compile
                    spare[kept, axis] = here[axis]
                kept += 1
            if (d_here >= 0.0) != (d_there >= 0.0):
                if abs(d_here) < abs(d_there) or (d_here >= 0.0 and d_here == -d_there):
                    start, end, share = here, there, d_here / (d_here - d_there)
                else:
                    start, end, share = there, here, d_there / (d_there - d_here)
                for axis in range(3):
                    spare[kept, axis] = start[axis] + share * (end[axis] - start[axis])
                kept += 1
        count = kept
        for i in range(count):
            for axis in range(3):
                polygon[i, axis] = spare[i, axis]
        if count < 3:
            return 0
    return count
