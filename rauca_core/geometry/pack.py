"""Packs charts into one square page, tightly: every place is tried, in several rotations.

xatlas packs the few large charts of a car to about 50 %; trying every place on a bitmap gains a fifth more texels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from ..contract import RaucaError
from .atlas import dilated, signed_uv_area, touched
from .mesh import Indices, Mask, Points

Habit = tuple[tuple[float, float, float], str]
CELL_TEXELS = 4  # charts are placed on a lattice of this pitch
ROTATIONS = 4
# Ways to choose among free places: weights of the larger extent reached, of rows and of columns; then the order.
HABITS = [
    (weights, order)
    for weights in ((0.0, 1.0, 0.01), (1.0, 0.2, 0.2), (0.0, 1.0, 0.6), (0.0, 0.5, 1.0))
    for order in ("extent", "area")
]
SEARCH_STEPS = 8
MANY_CHARTS = 80


@dataclass(frozen=True, eq=False)
class Footprint:
    """A chart at one scale and rotation.

    Attributes:
        points: (F, 3, 2) texels, from its own first corner on.
        mask: lattice cells that it touches.
        runs: the same as stretches of cells along a row: how long, and the bits of a page at which they begin; shortest
            first.
    """

    points: Points
    mask: Mask
    runs: list[tuple[int, list[int]]]


def pack_charts(uvs: Points, chart: Indices, size: int, padding: int) -> Points:
    """Place charts on a page at the largest common scale that fits.

    Args:
        uvs: (F, 3, 2) per corner, each chart in a plane of its own, all in one unit of length.
        chart: (F,) chart of each face.
        size, padding: page and least distance between charts and from the border, texels.

    Returns:
        (F, 3, 2) UVs in [0, 1].
    """
    members = [uvs[chart == k] for k in range(int(chart.max()) + 1)]
    area = sum(float(np.abs(signed_uv_area(m)).sum()) for m in members)
    low, high = 0.0, 0.9  # of the page filled by charts
    best = None
    gap = -(-padding // CELL_TEXELS)
    cells = size // CELL_TEXELS - 2 * gap
    # Hundreds of charts take one habit each time, or the search would take minutes.
    few = len(members) <= MANY_CHARTS
    for _ in range(SEARCH_STEPS):
        fraction = (low + high) / 2
        scaled = [m * (size * np.sqrt(fraction / area)) for m in members]

        def rotations(k: int, scaled: list[Points] = scaled) -> list[Footprint]:
            return _footprints(scaled[k], cells)

        shared = cache(rotations) if few else rotations  # every habit asks for the same ones
        tries = (_place_all(members, shared, cells, gap, habit) for habit in (HABITS if few else HABITS[:1]))
        placed = next((t for t in tries if t is not None), None)
        if placed is None:
            high = fraction
        else:
            low, best = fraction, placed
    if best is None:
        raise RaucaError(
            f"the paint's {len(members)} charts do not fit {size} texels; join parts or use a larger atlas"
        )
    result = np.empty_like(uvs)
    for k, points in enumerate(best):
        result[chart == k] = points / size
    return result


def _place_all(
    members: list[Points], rotations: Callable[[int], list[Footprint]], cells: int, gap: int, habit: Habit
) -> list[Points] | None:
    """Texel positions of every chart at one scale, largest chart first; None when they do not fit.

    Args:
        members: charts at any one scale, for their order.
        rotations: the footprints of a chart at the scale tried.
        cells, gap: the page without its border, and the least distance between charts, lattice cells.
    """
    taken = np.zeros((cells, _stride(cells)), np.bool_)
    result: list[Points | None] = [None] * len(members)
    weights, order = habit
    big = [np.abs(signed_uv_area(m)).sum() if order == "area" else np.ptp(m, axis=(0, 1)).max() for m in members]
    for k in sorted(range(len(members)), key=lambda i: -round(big[i], 4)):
        spot = _best_spot(rotations(k), taken, weights)
        if spot is None:
            return None
        chosen, row, column = spot
        wide = dilated(np.pad(chosen.mask, gap), gap)
        top, left = max(row - gap, 0), max(column - gap, 0)
        bottom, right = min(row + chosen.mask.shape[0] + gap, cells), min(column + chosen.mask.shape[1] + gap, cells)
        taken[top:bottom, left:right] |= wide[
            top - row + gap : bottom - row + gap, left - column + gap : right - column + gap
        ]
        result[k] = chosen.points + (np.array([column, row]) + gap) * CELL_TEXELS
    return [np.asarray(points) for points in result]


def _footprints(points: Points, cells: int) -> list[Footprint]:
    """A chart in every rotation that the page of (cells, cells) can hold."""
    found = []
    lean = _lean(points)
    for turn in range(ROTATIONS):
        angle = turn * 2 * np.pi / ROTATIONS - lean
        rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        turned = points @ rotation.T
        turned += 0.02 - turned.min(axis=(0, 1))  # a little inside its cells: touching counts as covering
        height, width = (int(np.ceil(turned[..., i].max() / CELL_TEXELS + 0.02)) for i in (1, 0))
        if max(height, width) <= cells:
            mask = _bitmap(turned, height, width)
            found.append(Footprint(turned, mask, _runs(mask, cells)))
    return found


def _best_spot(
    rotations: list[Footprint], taken: Mask, weights: tuple[float, float, float]
) -> tuple[Footprint, int, int] | None:
    """The rotation and free place that keep a chart closest to the page's first corner."""
    cells = len(taken)
    best, spot = np.inf, None
    for footprint in rotations:
        height, width = footprint.mask.shape
        free = ~_collisions(taken, footprint)[: cells - height + 1, : cells - width + 1]
        rows = np.flatnonzero(free.any(axis=1))
        if len(rows) == 0:
            continue
        columns = free.argmax(axis=1)[rows]  # a row's first: farther along it, no weight rewards
        down, right = rows + height, columns + width
        reach = weights[0] * np.maximum(down, right) + weights[1] * down + weights[2] * right
        first = int(np.argmin(reach))
        if reach[first] < best - 1e-6:
            best, spot = reach[first], (footprint, int(rows[first]), int(columns[first]))
    return spot


def _collisions(taken: Mask, footprint: Footprint) -> Mask:
    """The places at which a chart's first corner may not lie.

    The page is one number: a bit for each cell, row after row, the first cell's the lowest. One shift of it moves all
    places at once: some hundred shifts of a few kilobytes try every one.

    Args:
        taken: (cells, :func:`_stride`) of the page; the result is alike.
    """
    spread = int.from_bytes(np.packbits(taken, bitorder="little").tobytes(), "little")
    length, blocked = 1, 0  # spread: bits with something taken in the ``length`` cells from there on
    for run, starts in footprint.runs:
        while length < run:
            step = min(length, run - length)
            spread |= spread >> step
            length += step
        for start in starts:
            blocked |= spread >> start
    packed = np.frombuffer(blocked.to_bytes(taken.size // 8, "little"), np.uint8)
    return np.unpackbits(packed, bitorder="little").reshape(taken.shape).view(np.bool_)


def _runs(mask: Mask, cells: int) -> list[tuple[int, list[int]]]:
    """A mask's :attr:`Footprint.runs` on a page of (cells, cells)."""
    edges = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, first = np.nonzero(edges == 1)
    lengths = np.nonzero(edges == -1)[1] - first
    starts = row * _stride(cells) + first
    return [(int(length), starts[lengths == length].tolist()) for length in np.unique(lengths)]


def _stride(cells: int) -> int:
    """Bits that a row takes: whole bytes."""
    return -(-cells // 8) * 8


def _bitmap(points: Points, height: int, width: int) -> Mask:
    """(height, width) lattice cells that a chart touches, row 0 at y = 0."""
    side = max(height, width)
    unit = points / (side * CELL_TEXELS)
    return touched(np.stack([unit[..., 0], 1 - unit[..., 1]], axis=-1), side)[:height, :width]


def _lean(points: Points) -> float:
    """Angle of the box of least area around a chart, radians."""
    flat = points.reshape(-1, 2)
    angles = np.linspace(0, np.pi / 2, 90, endpoint=False)
    c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
    x, y = flat[:, 0] * c + flat[:, 1] * s, flat[:, 1] * c - flat[:, 0] * s
    return float(angles[np.argmin(np.round(np.ptp(x, axis=1) * np.ptp(y, axis=1), 6))])
