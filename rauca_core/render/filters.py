"""Pixel filters: how a renderer weighs the light that falls around a pixel's centre."""

from __future__ import annotations

from math import pi

import numpy as np
from numpy.typing import NDArray

from ..contract import RaucaError

FILTERS = ("blackman-harris", "box")
_CYCLES_WIDTH = 3.0  # pixels: Cycles doubles its default `filter_width` of 1.5 for Blackman-Harris


def filter_table(name: str, samples: int) -> tuple[NDArray[np.float64], int]:
    """Weights of the subsamples around a pixel.

    Returns:
        (n, n) weights that sum to 1, and how many pixels the filter reaches beyond the pixel itself; n is
        ``samples * (2 * reach + 1)``.

    Raises:
        RaucaError: unknown filter.
    """
    if name == "box":
        return np.full((samples, samples), 1.0 / samples**2), 0
    if name != "blackman-harris":
        raise RaucaError(f"filter: {name!r} is unknown; choose one of {', '.join(FILTERS)}")
    offsets = (np.arange(3 * samples) + 0.5) / samples - 1.5
    phase = 2 * pi * (offsets / _CYCLES_WIDTH + 0.5)
    line = 0.35875 - 0.48829 * np.cos(phase) + 0.14128 * np.cos(2 * phase) - 0.01168 * np.cos(3 * phase)
    line /= line.sum()
    return np.outer(line, line), 1
