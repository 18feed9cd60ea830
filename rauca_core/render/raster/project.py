"""Vertices to the rasterizer's numbers: homogeneous pixels, depth, fixed point, and on which side of the clip planes.

Short loops over few arrays, none of which branches: the compiler makes vectors of them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..kernels import njit
from .fixed_point import BROKEN, INSIDE, LIMIT, ONE, OUTSIDE, Screen


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
    """Project positions (V, 3)."""
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
