"""A balanced part of a plan too large to be rendered whole.

A small part tells nearly as much about each parameter when every pair of values meets equally often, as in a Latin
square.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from .dataset import Plan
from .seeding import named_rng

_SINGLE_WEIGHT = 20.0  # a value's own share counts for more than that of its pairs


def balanced_frames(plan: Plan, count: int) -> list[str]:
    """Ids of ``count`` frames of a plan (all if it has no more), in the plan's order.

    Locations, azimuths, elevations, distances and weathers, and all pairs of them, are as even as a greedy choice makes
    them. The choice of fewer frames is part of the choice of more.
    """
    ring, weathers = plan.ring, len(plan.weathers)
    shape = (plan.locations, weathers, len(ring.distances_m), len(ring.elevations_deg), len(ring.azimuths_deg))
    every = [frame_id for frame_id, *_ in plan.frame_ids()]  # in just this order of axes
    chosen = range(len(every)) if count >= len(every) else sorted(_even_choice(shape, count, plan.seed).tolist())
    return [every[index] for index in chosen]


def _even_choice(shape: tuple[int, ...], count: int, seed: int) -> NDArray[np.int64]:
    """(count,) distinct flat indices into a grid: each is the point whose values, and pairs of them, were taken least.

    Equals are told apart by a seeded draw, once for all.
    """
    # The stream's name is that of its first use: another one would choose other views than published figures have.
    cost = named_rng("held-out views", seed).random(shape) * 1e-3
    axes = range(len(shape))
    subsets = [*combinations(axes, 1), *combinations(axes, 2)]
    chosen = []
    for _ in range(count):
        flat = int(cost.argmin())
        chosen.append(flat)
        point = np.unravel_index(flat, shape)
        for subset in subsets:
            sharing = tuple(int(point[axis]) if axis in subset else slice(None) for axis in axes)
            rarity = float(np.prod([shape[axis] for axis in subset]))
            cost[sharing] += rarity * (_SINGLE_WEIGHT if len(subset) == 1 else 1.0)
        cost[point] = np.inf
    return np.array(chosen, np.int64)
