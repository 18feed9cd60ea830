"""Meshes put together from grids and polygons, and their shading normals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Floats = NDArray[np.floating]
Indices = NDArray[np.int64]
Integers = NDArray[np.integer]
Mask = NDArray[np.bool_]
WELD_M = 1e-5


@dataclass
class MeshParts:
    """Triangles with a material name each, collected part by part; vertices of the same place are welded at the end."""

    _corners: list[Points] = field(default_factory=list)
    _names: list[NDArray[np.str_]] = field(default_factory=list)

    def triangles(self, corners: Points, material: str | NDArray[np.str_]) -> None:
        """Add triangles (N, 3, 3), counter-clockwise from outside; one material, or one per triangle (N,)."""
        self._corners.append(corners)
        self._names.append(np.broadcast_to(np.asarray(material, dtype="U32"), (len(corners),)))

    def grid(self, points: Points, material: str | NDArray[np.str_], flip: bool = False) -> None:
        """Add a grid of points (N, M, 3), seen counter-clockwise going from N to M, or from behind with ``flip``.

        ``material`` is one name, or one per cell (N - 1, M - 1). Each cell is cut along its shorter diagonal.
        """
        a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
        first = np.linalg.norm(c - a, axis=-1) <= np.linalg.norm(d - b, axis=-1) + 1e-9
        pick = first[..., None, None]
        one = np.where(pick, np.stack([a, b, c], 2), np.stack([a, b, d], 2))
        two = np.where(pick, np.stack([a, c, d], 2), np.stack([b, c, d], 2))
        corners = np.stack([one, two], 2).reshape(-1, 3, 3)
        names = np.broadcast_to(np.asarray(material, dtype="U32"), a.shape[:2])
        self.triangles(corners[:, ::-1] if flip else corners, np.repeat(names.ravel(), 2))

    def mirrored(self) -> MeshParts:
        """The same parts on the other side of the plane y = 0."""
        flip = np.array([1.0, -1.0, 1.0])
        return MeshParts([(c * flip)[:, ::-1] for c in self._corners], list(self._names))

    def both_sides(self) -> MeshParts:
        """These parts and their mirror image."""
        other = self.mirrored()
        return MeshParts(self._corners + other._corners, self._names + other._names)

    def welded(self) -> tuple[Points, NDArray[np.int32], NDArray[np.str_]]:
        """Vertices (V, 3), triangles (F, 3) and material names (F,); degenerate triangles are gone."""
        corners, names = np.concatenate(self._corners), np.concatenate(self._names)
        _, index, inverse = np.unique(
            np.round(corners.reshape(-1, 3) / WELD_M).astype(np.int64), axis=0, return_index=True, return_inverse=True
        )
        positions = corners.reshape(-1, 3)[index]
        faces = inverse.reshape(-1, 3).astype(np.int32)
        edges = positions[faces[:, 1:]] - positions[faces[:, :1]]
        double_area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        longest = np.linalg.norm(positions[faces] - positions[np.roll(faces, 1, axis=1)], axis=2).max(axis=1)
        keep = double_area > 1e-4 * longest**2 + 1e-12
        used, compact = np.unique(faces[keep], return_inverse=True)
        return positions[used], compact.reshape(-1, 3).astype(np.int32), names[keep]


def face_normals(positions: Floats, triangles: Integers) -> tuple[Points, Points]:
    """Unit normals (F, 3) and areas (F,) of triangles; a degenerate triangle has the normal 0 and the area 0."""
    corners = np.asarray(positions, np.float64)[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1)
    return cross / np.maximum(length, 1e-30)[:, None], length / 2


def crease_normals(positions: Floats, triangles: Integers, angle_deg: float) -> NDArray[np.float32]:
    """Unit shading normals (F, 3, 3) per corner: smooth, but split where faces meet at more than ``angle_deg``.

    A corner's normal is the mean of the face normals around its vertex that lie within the angle of its own face,
    weighted by the angle each face spans there (so that the triangulation does not show).
    """
    normals, _ = face_normals(positions, triangles)
    weights = _corner_angles(np.asarray(positions, np.float64)[triangles])
    vertex = triangles.ravel()
    order = np.argsort(vertex, kind="stable")
    counts = np.bincount(vertex, minlength=len(positions))
    start = np.cumsum(counts) - counts
    # Every pair (corner, other corner at the same vertex), as flat arrays.
    corner, offset = spread_out(counts[vertex])
    other = order[start[vertex[corner]] + offset]
    near = (normals[corner // 3] * normals[other // 3]).sum(axis=1) >= np.cos(np.radians(angle_deg)) - 1e-9
    summed = np.zeros((len(vertex), 3))
    contribution = normals[other[near] // 3] * weights.ravel()[other[near]][:, None]
    for axis in range(3):
        summed[:, axis] = np.bincount(corner[near], contribution[:, axis], minlength=len(vertex))
    length = np.linalg.norm(summed, axis=1, keepdims=True)
    own = np.repeat(normals, 3, axis=0)
    unit = np.where(length > 1e-9, summed / np.maximum(length, 1e-9), own)
    return unit.reshape(-1, 3, 3).astype(np.float32)


def _corner_angles(corners: Points) -> Points:
    """(F, 3) angle at each corner of triangles (F, 3, 3), radians."""
    out = np.roll(corners, -1, axis=1) - corners
    back = np.roll(corners, 1, axis=1) - corners
    cosine = (out * back).sum(axis=2) / np.maximum(np.linalg.norm(out, axis=2) * np.linalg.norm(back, axis=2), 1e-30)
    return np.arccos(np.clip(cosine, -1, 1))


def spread_out(counts: Integers) -> tuple[Indices, Indices]:
    """Of ``counts[i]`` items for each i, laid end to end: the i of each, and its number among those of i."""
    owner = np.repeat(np.arange(len(counts)), counts)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)


def chunks(counts: Integers, most: int) -> Iterator[slice]:
    """Stretches of ``counts`` that sum to about ``most``, or hold a single one."""
    ends, start = np.cumsum(counts), 0
    while start < len(counts):
        stop = max(int(np.searchsorted(ends, ends[start] - counts[start] + most)), start + 1)
        yield slice(start, stop)
        start = stop
