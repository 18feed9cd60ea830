"""How small the smallest patch of a finished map is on the vehicle: measured on the map and the mesh alone.

Nothing here knows how a camouflage was made. Points are thrown on the surface and sorted into small cubes; a cube that
holds two colors is on a patch's edge. The largest disc inside a patch reaches from its innermost cube to the nearest
edge, and its diameter is the patch's size; where paint ends there is no edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...contract import Vehicle
from ...contract.seeding import named_rng

Array = NDArray[np.float64]
PER_CUBE = 12  # points thrown for every face of a cube of surface


@dataclass(frozen=True)
class Granulometry:
    """Sizes of patches on the vehicle, metres, good to about the side of the cubes.

    Attributes:
        smallest: diameter of the disc that the smallest patch holds; infinite with one color on every part.
        median: of patches, each counted by its area.
        edges: share of the surface in cubes of several colors; near 1 where patches are no larger than cubes.
    """

    smallest: float
    median: float
    edges: float


def measure_patches(vehicle: Vehicle, uv_map: NDArray[np.uint8], cube_m: float) -> Granulometry:
    """Measure a UV map (size, size, 3), 8-bit; ``cube_m``: a tenth of the size that is expected, or less."""
    from scipy.spatial import cKDTree

    points, colors = scatter_points(vehicle, uv_map, cube_m)
    cubes, steps = _cubes(points, cube_m)
    colors = np.unique(colors, return_inverse=True)[1].ravel()
    # What is sorted into parts is a color in a cube: a patch's thin corner hangs on to it through cubes of its edge.
    shade = int(colors.max()) + 1
    keys, first, counts = np.unique(cubes * shade + colors, return_index=True, return_counts=True)
    number = np.bincount(np.unique(keys // shade, return_inverse=True)[1])
    mixed = np.repeat(number, number) > 1
    part = _parts(keys, steps * shade)
    radius = np.where(mixed, 0.0, np.inf)
    if mixed.any():
        radius[~mixed] = cKDTree(points[first[mixed]]).query(points[first[~mixed]])[0]
    area = np.bincount(part, counts)
    size = np.zeros(len(area))
    np.maximum.at(size, part, 2 * radius)
    resolved = area >= PER_CUBE  # crumbs smaller than a cube's face are where texels straddle an edge, or below sight
    size, area = size[resolved], area[resolved]
    if not len(size):
        return Granulometry(0.0, 0.0, 1.0)
    rank = np.argsort(size)
    middle = rank[np.searchsorted(np.cumsum(area[rank]), area.sum() / 2)]
    return Granulometry(float(size.min()), float(size[middle]), float(counts[mixed].sum() / counts.sum()))


def _cubes(points: Array, side: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The number of each point's cube (N,), and what to add to it for itself and its 26 neighbors (27,)."""
    cells = np.floor(points / side).astype(np.int64)
    cells -= cells.min(0) - 1
    spread = cells.max(0) + 2
    around = np.stack(np.meshgrid(*[(-1, 0, 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    place = np.array([spread[1] * spread[2], spread[2], 1])
    return cells @ place, around @ place


def scatter_points(vehicle: Vehicle, uv_map: NDArray[np.uint8], cube_m: float) -> tuple[Array, NDArray[np.int64]]:
    """Points (N, 3) thrown evenly on the paint, metres, and the map's color there as one number (N,)."""
    paint = vehicle.paint_faces()
    corners = vehicle.positions[vehicle.triangles[paint]].astype(np.float64)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    rng = named_rng("granulometry", 0)
    count = int(np.clip(PER_CUBE * areas.sum() / cube_m**2, 1000, 5_000_000))
    face = rng.choice(len(areas), count, p=areas / areas.sum())
    one, two = rng.random((2, count))
    flip = one + two > 1
    one, two = np.where(flip, 1 - one, one), np.where(flip, 1 - two, two)
    shares = np.stack([1 - one - two, one, two], 1)
    points = np.einsum("nk,nkc->nc", shares, corners[face])
    uv = np.einsum("nk,nkc->nc", shares, vehicle.uvs[paint][face].astype(np.float64))
    rows, columns = _texel(uv, len(uv_map))
    painted = vehicle.paint_mask[_texel(uv, len(vehicle.paint_mask))] >= 128
    color = uv_map[rows, columns].astype(np.int64) @ np.array([65536, 256, 1])
    return points[painted], color[painted]


def _texel(uv: Array, size: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    column, row = (np.clip((x * size).astype(np.int64), 0, size - 1) for x in (uv[:, 0], 1 - uv[:, 1]))
    return row, column


def _parts(keys: NDArray[np.int64], steps: NDArray[np.int64]) -> NDArray[np.int32]:
    """(N,) what touches shares a number, from 0; ``keys`` ascend, neighbors are a step apart."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = []
    for step in steps:
        place = np.searchsorted(keys, keys + step).clip(max=len(keys) - 1)
        here = np.flatnonzero(keys[place] == keys + step)
        pairs.append(np.stack([here, place[here]]))
    ones, both = np.ones(sum(pair.shape[1] for pair in pairs), bool), np.concatenate(pairs, 1)
    return connected_components(coo_array((ones, tuple(both)), (len(keys),) * 2), directed=False)[1]
