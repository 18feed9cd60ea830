"""The surface of a vehicle in patches, each wide enough for a disc of a given diameter.

Seeds are drawn at random, none closer to another than a spacing along the surface, until no place is left; a patch is
all paint that is closer to its seed than to any other. Half the spacing around a seed is then its own: a disc, unless
the paint ends. Patches know nothing of UV charts and run on over their seams.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...contract.seeding import named_rng
from ...render.kernels import njit
from .surface import Links, TexelPoints

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
        owner[start], best[start], blocked[start] = number, 0.0, True
        heap = [(0.0, start)]
        _spread(heap, owner, best, blocked, number, spacing, indptr, neighbors, metres)
        number += 1
    return owner, seeds[:number].copy()


@njit(cache=True, nogil=True)
def _spread(
    heap: Any,
    owner: Any,
    best: Any,
    blocked: Any,
    number: int,
    spacing: float,
    indptr: Any,
    neighbors: Any,
    metres: Any,
) -> None:
    """Dijkstra from a seed out to ``spacing``; what is reached is blocked, what it is closest to is its own."""
    seen = {heap[0][1]: 0.0}
    while len(heap) > 0:
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
