"""Pixel filters: how a renderer weighs the light that falls around a pixel's center."""

from __future__ import annotations

from math import pi

import numpy as np
from numpy.typing import NDArray

from ..contract import RaucaError
from .raster.pattern import Pattern

FILTERS = ("blackman-harris", "box")
_CYCLES_WIDTH = 3.0  # pixels: Cycles doubles its default `filter_width` of 1.5 for Blackman-Harris


def filter_table(name: str, pattern: Pattern) -> tuple[NDArray[np.float64], int]:
    """Weights of the subsamples around a pixel.

    Returns:
        ((2 * reach + 1) * rows, (2 * reach + 1) * columns) weights that sum to 1, and ``reach``: how many pixels the
        filter extends beyond the pixel itself.

    Raises:
        RaucaError: unknown filter.
    """
    if name == "box":
        return np.full((pattern.rows, pattern.columns), 1.0 / pattern.number), 0
    if name != "blackman-harris":
        raise RaucaError(f"filter: {name!r} is unknown; choose one of {', '.join(FILTERS)}")
    y = (np.arange(3 * pattern.rows) + 0.5) / pattern.rows - 1.5
    x = (np.arange(3 * pattern.columns)[None] + np.tile(pattern.shifts, 3)[:, None]) / pattern.columns - 1.5
    table = _blackman_harris(y)[:, None] * _blackman_harris(x)
    return table / table.sum(), 1


def _blackman_harris(offsets: NDArray[np.float64]) -> NDArray[np.float64]:
    phase = 2 * pi * (offsets / _CYCLES_WIDTH + 0.5)
    return 0.35875 - 0.48829 * np.cos(phase) + 0.14128 * np.cos(2 * phase) - 0.01168 * np.cos(3 * phase)
