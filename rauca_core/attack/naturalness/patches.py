"""The paintable texels as points of the vehicle's surface, and patches of them that each hold a disc of a diameter.

Texels that are neighbors on the map may be far apart on the vehicle, and neighbors on the vehicle may lie on two
charts. Distances along the surface are sums of steps between neighbors, in metres.

Seeds are drawn at random, none closer to another than a spacing along the surface, until no place is left; a patch is
all paint that is closer to its seed than to any other. Half the spacing around a seed is then its own: a disc, unless
the paint ends. Patches know nothing of UV charts and run on over their seams.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...contract import Vehicle
from ...contract.seeding import named_rng
from ...render import Pyramid
from ...render.onto_atlas import read_on_atlas
from ...render.surface import Surface
from ...runtime.kernels import njit

Array = NDArray[np.float64]
REACH, GAP_M = 2.0, 0.02  # steps of the map, metres: charts closer than the larger are joined, and panels beside a gap
STEP = 2.0  # steps of the map: neighbors there that are farther apart on the vehicle are of two charts
FACING = -0.5  # cosine: surfaces that look away from each other, as the two sides of a sheet, are not joined
OFFSETS = ((0, 1), (1, 0), (1, 1), (1, -1))


@dataclass(frozen=True, eq=False)
class TexelPoints:
    """Where texels lie on the vehicle.

    Attributes:
        positions: (P, 3) center of the paint under each texel, metres.
        normals: (P, 3) unit.
        steps: (P, 2) metres on the surface for a step down and one to the right on the map.
        sides: (P,) side of a square as large as the texel, metres.
        areas: (P,) paint under each texel, square metres.
    """

    positions: Array
    normals: Array
    steps: Array
    sides: Array
    areas: Array

    @staticmethod
    def of(vehicle: Vehicle, atlas: Pyramid) -> TexelPoints:
        """The texels of a vehicle's atlas; raises :class:`RaucaError` for an atlas of another vehicle."""
        corners = 3 * len(vehicle.triangles)
        side = math.isqrt(corners) | 1  # odd: a list without coarser levels
        side += 2 * (side**2 < corners)
        listed = Pyramid((np.arange(side**2) < corners).astype(np.float32).reshape(side, side))

        def look(surface: Surface) -> tuple[NDArray[np.int32], Array]:
            return (3 * surface.faces[:, None] + np.arange(3)).astype(np.int32), surface.barycentrics

        mean = read_on_atlas(vehicle, atlas, listed, look)
        rows = np.repeat(np.arange(len(atlas.texels)), np.diff(mean.indptr))

        def carried(values: NDArray[Any]) -> Array:
            every = values.reshape(corners, -1)[mean.columns] * mean.weights[:, None]
            return np.stack([np.bincount(rows, column, len(atlas.texels)) for column in every.T], 1)

        triangles = vehicle.positions[vehicle.triangles].astype(np.float64)
        normals = carried(vehicle.normals.astype(np.float64))
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        measures = np.concatenate(_texel_measures(vehicle, atlas.size), 1)
        down, right, side = carried(np.repeat(measures, 3, 0)).T
        areas = atlas.coverage[0].ravel()[atlas.texels] * side**2
        return TexelPoints(carried(triangles), normals, np.stack([down, right], 1), side, areas)


def _texel_measures(vehicle: Vehicle, size: int) -> tuple[Array, Array]:
    """Of every face: metres per texel down and to the right (F, 2), and the root of metres^2 per texel (F, 1)."""
    one, two, three = vehicle.positions[vehicle.triangles].astype(np.float64).transpose(1, 0, 2)
    edges = np.stack([two - one, three - one], 1)
    (u1, v1), (u2, v2) = ((vehicle.uvs[:, k] - vehicle.uvs[:, 0]).astype(np.float64).T * size for k in (1, 2))
    texels = u1 * v2 - u2 * v1
    inverse = np.stack([np.stack([v2, -v1], 1), np.stack([-u2, u1], 1)], 1)  # times texels: edges to u and v
    texels = np.where(np.abs(texels) > 1e-12, texels, np.inf)  # a face without area on the map has no texel
    along = np.linalg.norm(np.einsum("fak,fkc->fac", inverse, edges), axis=2) / np.abs(texels)[:, None]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    return along[:, ::-1], np.sqrt(area / np.abs(texels))[:, None]


@dataclass(frozen=True, eq=False)
class Links:
    """Which texels lie side by side on the surface, in compressed rows, both ways.

    Attributes:
        indptr: (P + 1,) int64 start of each row; ``neighbors`` (N,) int32; ``metres`` (N,) float32 between them.
    """

    indptr: NDArray[np.int64]
    neighbors: NDArray[np.int32]
    metres: NDArray[np.float32]


def link(points: TexelPoints, texels: NDArray[np.int64], size: int) -> Links:
    """Join the eight neighbors on the map where they touch on the vehicle, and charts where their edges meet there.

    Args:
        texels: (P,) positions ``row * size + column``, see ``Pyramid.texels``.
    """
    place = np.full((size + 2, size + 2), -1, np.int64)  # with a frame of nothing around the map
    rows, columns = np.divmod(texels, size)
    place[rows + 1, columns + 1] = np.arange(len(texels))
    pairs = []
    for down, right in OFFSETS:
        other = place[rows + 1 + down, columns + 1 + right]
        here = np.flatnonzero(other >= 0)
        there = other[here]
        apart = np.linalg.norm(points.positions[here] - points.positions[there], axis=1)
        step = points.steps @ (down, abs(right))
        near = apart <= STEP * np.maximum(step[here], step[there])
        pairs.append(np.stack([here[near], there[near]], 1))
    degree = np.bincount(np.concatenate(pairs).ravel(), minlength=len(texels))
    edge = np.flatnonzero(degree < 2 * len(OFFSETS))
    pairs.append(_across_seams(points, edge))
    return _compress(np.concatenate(pairs), points)


def _across_seams(points: TexelPoints, edge: NDArray[np.int64]) -> NDArray[np.int64]:
    """Pairs (N, 2) of chart edge texels that lie close together on the vehicle."""
    from scipy.spatial import cKDTree  # here: only who asks for patches needs it

    if not len(edge):
        return np.empty((0, 2), np.int64)
    reach = max(REACH * float(np.median(points.steps[edge].max(1))), GAP_M)
    pairs = cKDTree(points.positions[edge]).query_pairs(reach, output_type="ndarray")
    cosines = (points.normals[edge[pairs[:, 0]]] * points.normals[edge[pairs[:, 1]]]).sum(1)
    return edge[pairs[cosines >= FACING]]


def _compress(pairs: NDArray[np.int64], points: TexelPoints) -> Links:
    count = len(points.sides)
    both = np.concatenate([pairs, pairs[:, ::-1]])
    both = both[np.argsort(both[:, 0], kind="stable")]
    indptr = np.concatenate([[0], np.cumsum(np.bincount(both[:, 0], minlength=count))]).astype(np.int64)
    metres = np.linalg.norm(points.positions[both[:, 0]] - points.positions[both[:, 1]], axis=1)
    return Links(indptr, both[:, 1].astype(np.int32), metres.astype(np.float32))


STRETCHED = 0.95  # quantile of the texels' length over width that counts
ROUNDING = 1.0  # texel sides that a patch's edge may be off, where texels straddle it


@dataclass(frozen=True, eq=False)
class Patches:
    """Attributes: ``of_texel`` (P,) int32 patch of each texel, counted from 0; ``seeds`` (M,) texel of each seed."""

    of_texel: NDArray[np.int32]
    seeds: NDArray[np.int64]

    @property
    def count(self) -> int:
        return len(self.seeds)


def make_patches(points: TexelPoints, links: Links, feature_m: float, seed: int) -> Patches:
    """Patches that hold a disc of diameter ``feature_m``, metres.

    Below the side of a texel every texel is a patch; where the paint of a part is smaller than a disc, it is one patch.
    """
    side = float(np.median(points.sides))
    spacing = feature_m * _detour(points) + ROUNDING * side if feature_m > side else 0.0
    order = named_rng(seed, "patches").permutation(len(points.sides))
    of_texel, seeds = _grow(links.indptr, links.neighbors, links.metres, order, spacing)
    return Patches(of_texel, seeds)


MIRRORED_M = 0.1  # metres: paint whose mirror image lies farther from any paint has no counterpart


def mirrored(patches: Patches, points: TexelPoints) -> Patches:
    """The left side's patches (y > 0 of the vehicle) on either side, each as its own mirror image on the right.

    Paint on the right that has no counterpart keeps its own patch.
    """
    from scipy.spatial import cKDTree  # here: only who asks for symmetry needs it

    flip, side = np.array([1.0, -1.0, 1.0]), points.positions[:, 1] >= 0
    left, right = np.flatnonzero(side), np.flatnonzero(~side)
    of_texel = patches.of_texel.copy()
    if len(left) and len(right):
        # The two sides of a sheet lie in one place and differ in where they face.
        placed = np.concatenate([points.positions, points.normals * MIRRORED_M / 2], 1)
        apart, nearest = cKDTree(placed[left]).query(placed[right] * np.tile(flip, 2))
        known = apart < MIRRORED_M
        of_texel[right[known]] = patches.of_texel[left[nearest[known]]]
    kept, renumbered = np.unique(of_texel, return_inverse=True)
    return Patches(renumbered.astype(np.int32), patches.seeds[kept])


def _detour(points: TexelPoints) -> float:
    """How much longer a way along steps to eight neighbors is than the straight one, at most.

    1.08 where texels are square; 1.41 where they are infinitely long.
    """
    length = np.quantile(points.steps.max(1) / np.maximum(points.steps.min(1), 1e-12), STRETCHED)
    return float(1 / np.cos(np.arctan(length) / 2))


@njit(cache=True, nogil=True)
def _grow(indptr: Any, neighbors: Any, metres: Any, order: Any, spacing: float) -> Any:
    """Seeds in turn, each taking what is closer to it than to the seeds before; a texel within reach is no seed."""
    count = indptr.shape[0] - 1
    owner, best = np.full(count, -1, np.int32), np.full(count, np.inf, np.float64)
    blocked = np.zeros(count, np.bool_)
    seeds = np.empty(count, np.int64)
    number = 0
    for start in order:
        if blocked[start]:
            continue
        seeds[number] = start
        heap, seen = [(0.0, start)], {start: 0.0}
        while len(heap) > 0:  # Dijkstra from the seed out to the spacing
            way, here = heapq.heappop(heap)
            if way > seen[here]:
                continue
            blocked[here] = True
            if way < best[here]:
                best[here], owner[here] = way, number
            for k in range(indptr[here], indptr[here + 1]):
                there, longer = np.int64(neighbors[k]), way + metres[k]
                if longer < spacing and (there not in seen or longer < seen[there]):
                    seen[there] = longer
                    heapq.heappush(heap, (longer, there))
        number += 1
    return owner, seeds[:number].copy()
