"""Where the subsamples of a pixel lie: a rank-1 lattice, whose every sample has a row and a column of its own.

A regular n x n grid meets an edge that runs along a pixel row with only n distinct heights. A rank-1 lattice of N = n^2
points meets every edge with close to N, for the same number of samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ..contract import RaucaError

PATTERNS = ("lattice", "grid")
# Four points: every lattice of four is a diagonal, blind to edges along it; the rotated grid is not.
_ROTATED_GRID = (0.375, 0.875, 0.125, 0.625)


@dataclass(frozen=True, eq=False)
class Pattern:
    """Subsamples that repeat in every pixel.

    Sample (row j, column i) of a pixel lies at ``((i + shifts[j]) / columns, (j + 0.5) / rows)`` of its width and
    height.

    Attributes:
        columns, rows: samples of a pixel along x, and rows of samples along y.
        shifts: (rows,) float64 in [0, 1), of a column's width.
    """

    columns: int
    rows: int
    shifts: NDArray[np.float64]

    @property
    def number(self) -> int:
        """Samples of a pixel."""
        return self.columns * self.rows

    def points(self) -> NDArray[np.float64]:
        """Positions (number, 2) of a pixel's samples in [0, 1)^2, row by row."""
        x = (np.arange(self.columns)[None, :] + self.shifts[:, None]) / self.columns
        y = np.broadcast_to((np.arange(self.rows)[:, None] + 0.5) / self.rows, x.shape)
        return np.stack([x.ravel(), y.ravel()], 1)


def pattern(samples: int, kind: str = "lattice") -> Pattern:
    """The pattern of ``samples`` x ``samples`` subsamples.

    Raises:
        RaucaError: unknown kind, or samples outside 1 to 16.
    """
    if not 1 <= samples <= 16:
        raise RaucaError(f"samples: {samples} is out of range; choose 1 to 16 per pixel and axis")
    if kind == "grid" or samples == 1:
        return Pattern(samples, samples, np.full(samples, 0.5))
    if kind != "lattice":
        raise RaucaError(f"pattern: {kind!r} is unknown; choose one of {', '.join(PATTERNS)}")
    if samples == 2:
        return Pattern(1, 4, np.array(_ROTATED_GRID))
    number = samples * samples
    return Pattern(1, number, (np.arange(number) * generator(number) % number + 0.5) / number)


@cache
def generator(number: int) -> int:
    """The multiplier g for which the points (k, g k mod number) lie furthest apart on the torus."""
    k = np.arange(1, number)

    def closest(g: int) -> int:
        across = g * k % number
        return int((np.minimum(k, number - k) ** 2 + np.minimum(across, number - across) ** 2).min())

    candidates = [g for g in range(1, number) if np.gcd(g, number) == 1]
    return max(candidates, key=closest)
