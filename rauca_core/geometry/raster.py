"""Which texels a triangle of the UV atlas covers: vectorized, without a window or a GPU."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

CHUNK = 2_000_000  # candidate texels tested at once


def covered(uvs: NDArray[np.floating], size: int, conservative: bool) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Texels under UV triangles.

    Args:
        uvs: (F, 3, 2) per corner, v up.
        size: the atlas is square, texels.
        conservative: every texel whose square the triangle touches; else those whose center lies strictly inside.

    Returns:
        Flat texel indices (row * size + column, row 0 at the top) and the face of each, both (N,).
    """
    corners = np.asarray(uvs, np.float64) * size
    corners[..., 1] = size - corners[..., 1]
    texels, faces = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    for face, column, row in _candidates(corners, size):
        inside = _inside(corners, face, column + 0.5, row + 0.5, 0.5 if conservative else 0.0)
        texels.append((row * size + column)[inside])
        faces.append(face[inside])
    return np.concatenate(texels), np.concatenate(faces)


def _candidates(corners: NDArray[np.float64], size: int) -> Iterator[tuple[NDArray[np.int64], ...]]:
    """(face, column, row) of every texel in the bounding boxes of triangles, in chunks."""
    low = np.clip(np.floor(corners.min(axis=1)), 0, size - 1).astype(np.int64)
    high = np.clip(np.floor(corners.max(axis=1)), 0, size - 1).astype(np.int64)
    extent = high - low + 1
    counts = extent.prod(axis=1)
    ends = np.cumsum(counts)
    start = 0
    while start < len(counts):
        stop = max(int(np.searchsorted(ends, ends[start] - counts[start] + CHUNK)), start + 1)
        chunk = np.arange(start, stop)
        face = np.repeat(chunk, counts[chunk])
        first = np.repeat(np.cumsum(counts[chunk]) - counts[chunk], counts[chunk])
        within = np.arange(len(face)) - first
        down, along = np.divmod(within, extent[face, 0])
        yield face, low[face, 0] + along, low[face, 1] + down
        start = stop


def _inside(
    corners: NDArray[np.float64], face: NDArray[np.int64], x: NDArray[np.float64], y: NDArray[np.float64], half: float
) -> NDArray[np.bool_]:
    """Whether the square of half-width ``half`` around (x, y) meets the triangle ``face``; for 0, strictly inside."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    area: NDArray[np.float64] = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    sign = np.sign(area)
    result = np.full(len(x), True) if half else (sign != 0)[face]
    for p, q in ((a, b), (b, c), (c, a)):
        dx, dy = sign * (q - p).T
        extent = np.abs(dx) + np.abs(dy)
        edge = dx[face] * (y - p[face, 1]) - dy[face] * (x - p[face, 0])
        # The strict test keeps a margin: a center on an edge two faces share belongs to neither, not to both.
        result &= edge >= -(half * extent)[face] if half else edge > (1e-7 * extent)[face]
    return result
