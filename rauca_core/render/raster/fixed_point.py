"""The numbers that every path of the rasterizer shares, so that all of them find the same faces to the bit.

Vertices and samples lie on one lattice of 1/65536 pixel, whatever the pattern: 31 bits hold the image and a guard band
around it, and an edge function, the sum of two products of differences, fits into 63.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...contract import Camera
from .pattern import Pattern

FRACTION = 16
ONE, HALF = 1 << FRACTION, 1 << (FRACTION - 1)
MAX_SIDE = 2**14  # pixels of an image, margin included
GUARD = 2.0**12  # pixels around it: MAX_SIDE + 2 * GUARD < 2^15, and twice the square of 2^15 * ONE is 2^63
DEPTH_TIE = 1.0 + 1e-9  # coplanar duplicates differ by rounding only, and the lowest face id must win
LIMIT = 1e30  # beyond it, products of three homogeneous coordinates could overflow

INSIDE, OUTSIDE, BROKEN = 0, 1, 2  # of the clip planes; broken is NaN, infinite or beyond LIMIT

Window = tuple[int, int, int, int]  # x0, y0 inclusive, x1, y1 exclusive, in samples from the image's corner


@dataclass(frozen=True, eq=False)
class Screen:
    """An image and its samples in fixed point.

    Row r of samples lies at ``y = (r * ONE + HALF) // rows`` and column c of it at
    ``x = (c * ONE + shifts[r % rows]) // columns``, counted from the image's corner: negative in the margin.

    Attributes:
        matrix: (3, 4) float64, from the world to homogeneous pixel coordinates.
        planes: (5, 3) float64 clip planes, see :func:`clip_planes`.
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
        planes = clip_planes(camera.width, camera.height, GUARD + margin)
        shifts = np.rint(pattern.shifts * ONE).astype(np.int64)
        return Screen(matrix, planes, near, pattern.columns, pattern.rows, shifts, limits)

    def lines(self, window: Window) -> tuple[NDArray[Any], ...]:
        """Of each row (h,) of a window: its y and its columns' shift in fixed point; both in pixels, float64."""
        r = np.arange(window[1], window[3])
        shifts = self.shifts[r % self.rows]
        return (r * ONE + HALF) // self.rows, shifts, shifts / (ONE * self.columns), (r + 0.5) / self.rows


def clip_planes(width: int, height: int, guard: float) -> NDArray[np.float64]:
    """Planes (5, 3) on homogeneous pixel coordinates (X, Y, w); ``plane @ point >= 0`` is kept.

    The first is w = 0, which becomes the near plane when its depth is taken off. The others are a guard band ``guard``
    pixels outside the image, so that vertices at any distance fit into fixed point.
    """
    return np.array(
        [
            [0.0, 0.0, 1.0],
            [1.0, 0.0, guard],
            [-1.0, 0.0, width + guard],
            [0.0, 1.0, guard],
            [0.0, -1.0, height + guard],
        ]
    )
