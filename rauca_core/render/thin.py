"""Thinning a view's taps: fewer taps for the least error, by rate against distortion.

A pixel that spans many texels reads most of them with nearly equal weights. Where siblings of the mip pyramid carry
nearly the weights that their parent would give them, one tap on the parent replaces them; a tap too small to matter
hands its weight to a sibling, or is dropped and the row normalized. Each step may add, per tap that it saves, a squared
weight error of about ``price``: for texels of variance v the expected squared error of a pixel is v times their sum.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..runtime.kernels import njit
from .mipmap import Tree

_UNSEEN, _STAYS, _MERGES = 0, -1, -2  # of a parent; larger numbers count its listed children
# The light of a pixel holds its paint coverage: a faint pixel may err more. Down to this coverage, not further.
_FAINT = 0.25


class Thinning(NamedTuple):
    """How to thin the rows of a matrix on a pyramid's texels.

    Attributes:
        tree: the pyramid's.
        price: squared weight error that one tap is worth at full coverage; 0 keeps all taps.
        state, slot, sums: buffers, which :func:`thin_row` leaves as it found them.
    """

    tree: Tree
    price: float
    state: NDArray[np.int64]
    slot: NDArray[np.int64]
    sums: NDArray[np.float64]

    @staticmethod
    def of(tree: Tree, price: float) -> Thinning:
        count = len(tree.parent)
        return Thinning(tree, float(price), np.zeros(count, np.int64), np.full(count, -1), np.zeros((count, 4)))


@njit(cache=True, nogil=True)
def thin_row(listed: Any, weights: Any, count: int, alpha: float, how: Any) -> int:
    """Thin one row in place.

    Args:
        listed, weights: buffers of 2 * count places or more; the first ``count`` hold the row's texels, each once, and
            weights that sum to 1.
        alpha: coverage of the row's pixel.
        how: see `Thinning`.

    Returns:
        The new count; texels ascend and weights sum to 1.
    """
    if how.price > 0.0:
        worth = how.price / max(alpha, _FAINT) ** 2
        for level in range(how.tree.level[-1]):
            count = _merge_siblings(listed, weights, count, level, worth, how)
        count = _drop_small(listed, weights, count, worth)
    texels, values = listed[:count].copy(), weights[:count].copy()
    order = np.argsort(texels)
    for k in range(count):
        listed[k], weights[k] = texels[order[k]], values[order[k]]
    return count


@njit(cache=True, nogil=True)
def _merge_siblings(listed: Any, weights: Any, count: int, level: int, worth: float, how: Any) -> int:
    """Replace the listed texels of one level by their parents where that is worth it; returns the new count.

    In a family that stays, one too small to matter hands its weight to the largest, which reads about the same place.
    """
    parent, level_of = how.tree.parent, how.tree.level
    state, slot, sums = how.state, how.slot, how.sums
    found = _sum_families(listed, weights, count, level, how)
    before = count
    if found > 0:
        for k in range(before):
            if level_of[listed[k]] != level:
                continue
            p = parent[listed[k]]
            if state[p] > 0:
                saved = state[p] - (0 if slot[p] >= 0 else 1)
                total, cross, square = sums[p, 0], sums[p, 1], sums[p, 2]
                error = square - 2.0 * total * cross + total * total * how.tree.spread[p]
                merges = saved > 0 and error <= worth * saved
                state[p] = _MERGES if merges else _STAYS
                if state[p] == _MERGES and slot[p] < 0:
                    slot[p], listed[count], weights[count] = count, p, 0.0
                    count += 1
            if state[p] == _MERGES:
                weights[slot[p]] += weights[k]
                weights[k] = -1.0
            elif weights[k] * weights[k] <= worth and k != int(sums[p, 3]):
                weights[int(sums[p, 3])] += weights[k]
                weights[k] = -1.0
    kept = 0
    for k in range(count):
        texel = listed[k]
        slot[texel] = -1
        if level_of[texel] == level:
            state[parent[texel]] = _UNSEEN
        if weights[k] >= 0.0:
            listed[kept], weights[kept] = texel, weights[k]
            kept += 1
    return kept


@njit(cache=True, nogil=True)
def _sum_families(listed: Any, weights: Any, count: int, level: int, how: Any) -> int:
    """Per parent of the listed texels of one level: how many, the sums of w, share * w and w^2, the largest's place."""
    parent, share, level_of = how.tree.parent, how.tree.share, how.tree.level
    state, slot, sums = how.state, how.slot, how.sums
    found = 0
    for k in range(count):
        texel = listed[k]
        if level_of[texel] == level + 1:
            slot[texel] = k
        if level_of[texel] != level:
            continue
        p = parent[texel]
        if state[p] == _UNSEEN:
            sums[p] = 0.0
            sums[p, 3] = k
        elif weights[k] > weights[int(sums[p, 3])]:
            sums[p, 3] = k
        state[p] += 1
        sums[p, 0] += weights[k]
        sums[p, 1] += share[texel] * weights[k]
        sums[p, 2] += weights[k] * weights[k]
        found += 1
    return found


@njit(cache=True, nogil=True)
def _drop_small(listed: Any, weights: Any, count: int, worth: float) -> int:
    """Drop taps whose squared weight is not worth them, never the largest; normalize the rest."""
    largest = np.argmax(weights[:count])
    kept, total = 0, 0.0
    for k in range(count):
        if weights[k] * weights[k] > worth or k == largest:
            listed[kept], weights[kept] = listed[k], weights[k]
            total += weights[k]
            kept += 1
    for k in range(kept):
        weights[k] /= total
    return kept
