"""Texels that a UV atlas covers, its charts, and how evenly they spend their texels."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .mesh import Floats, Indices, Integers, Mask, Points, chunks, face_normals, spread_out

CHUNK = 2_000_000  # candidate texels tested at once


def covered(uvs: Floats, size: int, conservative: bool) -> tuple[Indices, Indices]:
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


def touched(uvs: Floats, size: int) -> Mask:
    """(size, size) texels that a UV triangle (F, 3, 2) touches."""
    mask = np.zeros(size * size, np.bool_)
    mask[covered(uvs, size, conservative=True)[0]] = True
    return mask.reshape(size, size)


def dilated(mask: Mask, steps: int) -> Mask:
    """A mask, empty along its border, that spread to squares of ``steps`` around each of its cells."""
    for axis in (0, 1):
        wide = mask.copy()
        for shift in range(1, steps + 1):
            wide |= np.roll(mask, shift, axis) | np.roll(mask, -shift, axis)
        mask = wide
    return mask


def _candidates(corners: Points, size: int) -> Iterator[tuple[Indices, ...]]:
    """(face, column, row) of every texel in the bounding boxes of triangles, in chunks."""
    low = np.clip(np.floor(corners.min(axis=1)), 0, size - 1).astype(np.int64)
    high = np.clip(np.floor(corners.max(axis=1)), 0, size - 1).astype(np.int64)
    extent = high - low + 1
    counts = extent.prod(axis=1)
    for chunk in chunks(counts, CHUNK):
        owner, within = spread_out(counts[chunk])
        face = chunk.start + owner
        down, along = np.divmod(within, extent[face, 0])
        yield face, low[face, 0] + along, low[face, 1] + down


def _inside(corners: Points, face: Indices, x: Floats, y: Floats, half: float) -> Mask:
    """Whether the square of half-width ``half`` around (x, y) meets the triangle ``face``; for 0, strictly inside."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    area: Floats = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    sign = np.sign(area)
    result = np.full(len(x), True) if half else (sign != 0)[face]
    for p, q in ((a, b), (b, c), (c, a)):
        dx, dy = sign * (q - p).T
        extent = np.abs(dx) + np.abs(dy)
        edge = dx[face] * (y - p[face, 1]) - dy[face] * (x - p[face, 0])
        # The strict test keeps a margin: a center on an edge two faces share belongs to neither, not to both.
        result &= edge >= -(half * extent)[face] if half else edge > (1e-7 * extent)[face]
    return result


def density_spread(uvs: Floats, positions: Floats, triangles: Integers, chart: Indices) -> Floats:
    """(charts,) spread of the texel density within each chart.

    The density of a face is ``sqrt(uv area / surface area)``; the spread is the coefficient of variation (standard
    deviation over mean) over a chart's faces, each weighted by its surface area. Faces without area do not count.
    """
    _, area = face_normals(np.asarray(positions, np.float64), triangles)
    density = np.sqrt(np.abs(signed_uv_area(uvs)) / np.maximum(area, 1e-30))
    weight = np.maximum(np.bincount(chart, area), 1e-30)
    mean = np.maximum(np.bincount(chart, area * density) / weight, 1e-30)
    return np.sqrt(np.bincount(chart, area * (density - mean[chart]) ** 2) / weight) / mean


def signed_uv_area(uvs: Floats) -> Floats:
    """(F,) area of UV triangles (F, 3, 2), negative where mirrored."""
    one, two = (uvs[:, 1:] - uvs[:, :1]).astype(np.float64).transpose(1, 0, 2)
    return (one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]) / 2


def chart_of_faces(triangles: Integers, uvs: NDArray[np.float32]) -> Indices:
    """(F,) chart number of each face: faces are joined where they share a vertex with the same UV."""
    keys = np.concatenate([triangles.reshape(-1, 1), np.round(uvs.reshape(-1, 2) * 2**20)], axis=1).astype(np.int64)
    _, corner = np.unique(keys, axis=0, return_inverse=True)
    corner = corner.reshape(-1, 3)
    label = np.arange(corner.max(initial=-1) + 1)
    while True:  # labels sink to the smallest of their chart; pointer jumping keeps the rounds few
        least = label[corner].min(axis=1)
        lowered = label.copy()
        for i in range(3):
            np.minimum.at(lowered, corner[:, i], least)
        lowered = lowered[lowered]
        if (lowered == label).all():
            return np.unique(label[corner[:, 0]], return_inverse=True)[1]
        label = lowered
