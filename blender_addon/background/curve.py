"""A curve as a small picture: how the loss went."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

SIDE = 192  # pixels
STROKE = 1.5  # half the line's width, pixels
COLOR = (0.36, 0.67, 0.95)  # sRGB
GRID = (0.5, 0.5, 0.5, 0.25)
MARGIN = 8  # pixels
MOST_POINTS = SIDE // 4  # the loss of one step jumps with its frames: what counts is how the runs of steps go


def curve(values: Sequence[float], side: int = SIDE) -> NDArray[np.float32]:
    """Draw ``values`` against their order, from their least to their greatest, as (side, side, 4) sRGB and alpha.

    Colors are premultiplied with alpha, as Blender draws its icons. Row 0 is at the top. Values that are not finite
    are left out; many are drawn by the means of equal runs of them.
    """
    picture = np.zeros((side, side, 4), np.float32)
    inner = side - 2 * MARGIN
    for line in np.linspace(MARGIN, side - 1 - MARGIN, 5).round().astype(int):
        picture[line, MARGIN:-MARGIN] = GRID
    points = _thinned(np.asarray(values, np.float64))
    if len(points) < 2:
        return _premultiplied(picture)
    low, high = float(points.min()), float(points.max())
    # A flat curve runs through the middle.
    level = (points - low) / (high - low) if high > low else np.full(len(points), 0.5)
    columns = np.arange(side)
    heights = np.interp((columns - MARGIN) / (inner - 1), np.linspace(0, 1, len(points)), level)
    rows = np.asarray(MARGIN + (1 - heights) * (inner - 1), np.float64)
    inside = (columns >= MARGIN) & (columns < side - MARGIN)
    _fill(picture, rows, inside)
    _stroke(picture, rows, inside)
    return _premultiplied(picture)


def _thinned(values: NDArray[np.float64]) -> NDArray[np.float64]:
    finite = values[np.isfinite(values)]
    if len(finite) <= MOST_POINTS:
        return finite
    return np.array([part.mean() for part in np.array_split(finite, MOST_POINTS)])


def _premultiplied(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    picture[:, :, :3] *= picture[:, :, 3:]
    return picture


def _fill(picture: NDArray[np.float32], rows: NDArray[np.float64], inside: NDArray[np.bool_]) -> None:
    """A faint area below the curve."""
    down = np.arange(len(picture))[:, None]
    area = (down > rows) & (down < len(picture) - MARGIN) & inside
    picture[area] = (*COLOR, 0.18)


def _stroke(picture: NDArray[np.float32], rows: NDArray[np.float64], inside: NDArray[np.bool_]) -> None:
    """The curve itself: as thick across as along, however steep."""
    down = np.arange(len(picture))[:, None]
    upper = np.minimum(rows, (rows + np.roll(rows, 1)) / 2)
    upper = np.minimum(upper, (rows + np.roll(rows, -1)) / 2)
    lower = np.maximum(rows, (rows + np.roll(rows, 1)) / 2)
    lower = np.maximum(lower, (rows + np.roll(rows, -1)) / 2)
    first, last = np.flatnonzero(inside)[[0, -1]]
    upper[[first, last]], lower[[first, last]] = rows[[first, last]], rows[[first, last]]
    beyond = np.maximum(np.maximum(upper - down, down - lower), 0)
    ink = np.clip(STROKE + 0.5 - beyond, 0, 1) * inside
    for channel, value in enumerate((*COLOR, 1.0)):
        layer = picture[:, :, channel]
        layer[...] = np.where(ink > 0, layer * (1 - ink) + value * ink, layer)
