"""The product of two sparse operators: a chain of lookups becomes one."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..contract import RaucaError
from .kernels import njit
from .sparse import SparseOperator


def compose(outer: SparseOperator, inner: SparseOperator) -> SparseOperator:
    """The operator that applies ``inner`` first and ``outer`` to its result; taps on the same column are merged.

    Rows list their columns in order. Sums are formed in float64; the weights keep the type of ``outer``.

    Raises:
        RaucaError: the rows of ``inner`` are not the columns of ``outer``.
    """
    if outer.shape[1] != inner.shape[0]:
        raise RaucaError(f"compose: {outer.shape} does not fit {inner.shape}; give operators that follow one another")
    indptr, columns, weights = _multiply(
        outer.indptr, outer.columns, outer.weights, inner.indptr, inner.columns, inner.weights, inner.shape[1]
    )
    return SparseOperator(indptr, columns, weights.astype(outer.weights.dtype), inner.shape[1])


def from_triplets(
    rows: Any, columns: Any, weights: Any, shape: tuple[int, int], dtype: type[np.floating] = np.float32
) -> SparseOperator:
    """An operator from entries in any order, zeros left out; within a row they keep their order, and may repeat."""
    used = weights != 0
    rows, columns, weights = rows[used], columns[used].astype(np.int32), weights[used].astype(dtype)
    indptr = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=shape[0]))]).astype(np.int64)
    place = _places(rows, indptr[:-1].copy())
    sorted_columns, sorted_weights = np.empty_like(columns), np.empty_like(weights)
    sorted_columns[place], sorted_weights[place] = columns, weights
    return SparseOperator(indptr, sorted_columns, sorted_weights, shape[1])


@njit(cache=True, nogil=True)
def _places(rows: Any, free: Any) -> Any:
    """Where each entry goes when entries are grouped by row; ``free`` is each row's next free place."""
    place = np.empty(rows.shape[0], np.int64)
    for k in range(rows.shape[0]):
        place[k] = free[rows[k]]
        free[rows[k]] += 1
    return place


@njit(cache=True, nogil=True)
def _multiply(
    indptr: Any, middle: Any, outer_weights: Any, inner_indptr: Any, inner_columns: Any, inner_weights: Any, width: int
) -> Any:
    """Gustavson's row by row product: a dense row of sums, and the list of places it touches."""
    rows = indptr.shape[0] - 1
    result_indptr, end = np.zeros(rows + 1, np.int64), 0
    columns, weights = np.empty(4096, np.int32), np.empty(4096, np.float64)
    sums, seen = np.zeros(width), np.full(width, -1, np.int32)
    for row in range(rows):
        begin = end
        for k in range(indptr[row], indptr[row + 1]):
            first, last = inner_indptr[middle[k]], inner_indptr[middle[k] + 1]
            while end + last - first > columns.shape[0]:
                columns = np.concatenate((columns, np.empty_like(columns)))
                weights = np.concatenate((weights, np.empty_like(weights)))
            for j in range(first, last):
                column = inner_columns[j]
                if seen[column] != row:
                    seen[column], sums[column] = row, 0.0
                    columns[end] = column
                    end += 1
                sums[column] += np.float64(outer_weights[k]) * inner_weights[j]
        columns[begin:end].sort()
        for k in range(begin, end):
            weights[k] = sums[columns[k]]
        result_indptr[row + 1] = end
    return result_indptr, columns[:end].copy(), weights[:end].copy()
