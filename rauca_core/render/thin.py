"""Thinning a view's taps: fewer taps for the least error, by rate against distortion.

A pixel that spans many texels reads most of them with nearly equal weights. Where siblings of the mip pyramid carry
nearly the weights that their parent would give them, one tap on the parent replaces them; a tap too small to matter is
dropped and the row normalised again. Each step may add, per tap that it saves, a squared weight error of at most
``price``: for texels of variance v the expected squared error of a pixel is v times the sum of those errors.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

_UNSEEN, _STAYS, _MERGES = 0, -1, -2  # of a parent; larger numbers count its listed children
# The light of a pixel holds its paint coverage: a faint pixel may err more. Down to this coverage, not further.
_FAINT = 0.25


@njit(cache=True, nogil=True)
def thin_rows(alpha: Any, indptr: Any, columns: Any, values: Any, tree: Any, levels: int, price: float) -> Any:
    """Thin every row of a matrix on the pyramid's texels.

    Args:
        alpha: (R,) coverage of the rows' pixels.
        indptr, columns, values: the matrix in compressed rows; each row sums to 1, without repeated columns.
        tree: parent (T,), share (T,), spread (T,), level (T,) of the pyramid's texels, see `pyramid.Pyramid.tree`.
        levels: of the pyramid.
        price: squared weight error that one tap is worth, per row of full coverage.

    Returns:
        indptr, columns, values of the thinned matrix; columns of a row ascend and its values sum to 1.
    """
    rows = indptr.shape[0] - 1
    longest = 1
    for r in range(rows):
        longest = max(longest, indptr[r + 1] - indptr[r])
    listed, weights = np.empty(2 * longest, np.int32), np.empty(2 * longest)
    state = np.zeros(tree[0].shape[0], np.int64)
    slot = np.full(tree[0].shape[0], -1, np.int64)
    sums = np.zeros((tree[0].shape[0], 3))
    new_indptr = np.zeros(rows + 1, np.int64)
    new_columns, new_values = np.empty(columns.shape[0], np.int32), np.empty(columns.shape[0])
    end = 0
    for r in range(rows):
        count = indptr[r + 1] - indptr[r]
        listed[:count] = columns[indptr[r] : indptr[r + 1]]
        weights[:count] = values[indptr[r] : indptr[r + 1]]
        worth = price / max(alpha[r], _FAINT) ** 2
        for level in range(levels - 1):
            count = _merge_siblings(listed, weights, count, level, tree, worth, state, slot, sums)
        count = _drop_small(listed, weights, count, worth)
        order = np.argsort(listed[:count])
        new_columns[end : end + count] = listed[:count][order]
        new_values[end : end + count] = weights[:count][order]
        end += count
        new_indptr[r + 1] = end
    return new_indptr, new_columns[:end].copy(), new_values[:end].copy()


@njit(cache=True, nogil=True)
def _merge_siblings(
    listed: Any, weights: Any, count: int, level: int, tree: Any, worth: float, state: Any, slot: Any, sums: Any
) -> int:
    """Replace the listed texels of one level by their parents where that is worth it; returns the new count."""
    parent, _, spread, level_of = tree
    found = _sum_families(listed, weights, count, level, tree, state, slot, sums)
    before = count
    if found > 0:
        for k in range(before):
            if level_of[listed[k]] != level:
                continue
            p = parent[listed[k]]
            if state[p] > 0:
                saved = state[p] - (0 if slot[p] >= 0 else 1)
                total, cross, square = sums[p, 0], sums[p, 1], sums[p, 2]
                error = square - 2.0 * total * cross + total * total * spread[p]
                state[p] = _MERGES if saved > 0 and error <= worth * saved else _STAYS
                if state[p] == _MERGES and slot[p] < 0:
                    slot[p], listed[count], weights[count] = count, p, 0.0
                    count += 1
            if state[p] == _MERGES:
                weights[slot[p]] += weights[k]
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
def _sum_families(
    listed: Any, weights: Any, count: int, level: int, tree: Any, state: Any, slot: Any, sums: Any
) -> int:
    """Per parent of the listed texels of one level: how many, and the sums of w, share * w and w^2."""
    parent, share, _, level_of = tree
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
        state[p] += 1
        sums[p, 0] += weights[k]
        sums[p, 1] += share[texel] * weights[k]
        sums[p, 2] += weights[k] * weights[k]
        found += 1
    return found


@njit(cache=True, nogil=True)
def _drop_small(listed: Any, weights: Any, count: int, worth: float) -> int:
    """Drop taps whose squared weight is not worth them, never the largest; normalise the rest."""
    largest = np.argmax(weights[:count])
    kept, total = 0, 0.0
    for k in range(count):
        if weights[k] * weights[k] > worth or k == largest:
            listed[kept], weights[kept] = listed[k], weights[k]
            total += weights[k]
            kept += 1
    weights[:kept] /= total
    return kept
