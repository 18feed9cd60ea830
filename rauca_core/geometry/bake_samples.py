"""Where the sample points of one UV layout lie in another: every point of the surface, once, row by row."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

CHUNK = 250_000  # samples at a time: some 20 ms, so that a window beside this thread stays alive


@dataclass(frozen=True, eq=False)
class Samples:
    """Sample points of the target layout that lie on a face; all arrays (N,), ``uv`` (N, 2) in the source layout."""

    face: NDArray[np.int64]
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    uv: NDArray[np.float64]


def samples(source_uvs: NDArray[np.floating], target_uvs: NDArray[np.floating], side: int) -> Iterator[Samples]:
    """Visit the centers of a ``side`` x ``side`` grid over the target layout, row 0 at the top (v = 1).

    A center on the edge that two faces share belongs to one of them. Within a face the two layouts are affine to each
    other, so ``uv`` is exact. float64, for faces thinner than a texel.

    Args:
        source_uvs, target_uvs: (F, 3, 2) per corner; points outside [0, 1] of the target are left out.
    """
    corners = np.array(target_uvs, np.float64) * side
    corners[..., 1] = side - corners[..., 1]
    origin, gradient = _affine(np.asarray(source_uvs, np.float64), corners)
    face, row, first, count = _spans(corners, side)
    ends = np.cumsum(count)
    start = 0
    while start < len(count):
        stop = max(int(np.searchsorted(ends, ends[start] - count[start] + CHUNK)), start + 1)
        here = slice(start, stop)
        span = np.repeat(np.arange(start, stop), count[here])
        within = np.arange(len(span)) - np.repeat(np.cumsum(count[here]) - count[here], count[here])
        column, f = first[span] + within, face[span]
        offset = np.stack([column + 0.5, row[span] + 0.5], axis=1) - corners[f, 0]
        uv = origin[f] + np.einsum("nij,nj->ni", gradient[f], offset)
        yield Samples(f, row[span], column, uv)
        start = stop


def _affine(source: NDArray[np.float64], target: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Source UV at each face's first corner (F, 2), and its change (F, 2, 2) per step in the target."""
    d, s = (np.swapaxes(x[:, 1:] - x[:, :1], 1, 2) for x in (target, source))
    area = d[:, 0, 0] * d[:, 1, 1] - d[:, 0, 1] * d[:, 1, 0]
    safe = np.where(np.abs(area) > 1e-30, area, 1.0)  # a face without area holds no center
    inverse = np.stack([d[:, 1, 1], -d[:, 0, 1], -d[:, 1, 0], d[:, 0, 0]], axis=1).reshape(-1, 2, 2)
    return source[:, 0], s @ (inverse / safe[:, None, None])


def _spans(corners: NDArray[np.float64], side: int) -> tuple[NDArray[np.int64], ...]:
    """(face, row, first column, number of columns) of every run of centers inside a face."""
    low, high = (_center(f(corners[..., 1], axis=1), side) for f in (np.min, np.max))
    rows = high - low
    face = np.repeat(np.arange(len(corners)), rows)
    row = low[face] + np.arange(len(face)) - np.repeat(np.cumsum(rows) - rows, rows)
    left, right = np.full(len(face), -np.inf), np.full(len(face), np.inf)
    a, b, c = (corners[face, i] for i in range(3))
    turn = np.sign((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))
    for p, q in ((a, b), (b, c), (c, a)):
        rise = q[:, 1] - p[:, 1]
        steep = np.where(rise == 0, 1.0, rise)
        x = p[:, 0] + (q[:, 0] - p[:, 0]) * ((row + 0.5 - p[:, 1]) / steep)
        left = np.where(turn * rise < 0, np.maximum(left, x), left)
        right = np.where(turn * rise > 0, np.minimum(right, x), right)
    first = _center(left, side)
    count = np.maximum(_center(right, side) - first, 0)
    keep = (count > 0) & (turn != 0)
    return face[keep], row[keep], first[keep], count[keep]


def _center(x: NDArray[np.float64], side: int) -> NDArray[np.int64]:
    """The first center at or after ``x``, within the grid."""
    return np.ceil(np.clip(x, 0, side) - 0.5).astype(np.int64)
