"""A fixed sparse linear operator on texels, with its exact adjoint as the gradient, and the product of two."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray
from torch import Tensor

from ..contract import RaucaError
from ..runtime.kernels import njit

Ints = NDArray[np.int32]
CHANNELS = 3
AHEAD = 256  # taps: 16 KiB of texels on their way


class SparseOperator:
    """A (rows, columns) matrix in compressed rows, applied to colors (columns, 3).

    On the CPU, single-threaded numba kernels gather forward and scatter backward: the order of every sum is fixed, so
    results repeat to the bit. On other devices torch adds up in any order.

    Attributes:
        indptr: (rows + 1,) int64 start of each row.
        columns: (N,) int32.
        weights: (N,) float32.
        shape: (rows, columns).
    """

    def __init__(self, indptr: NDArray[np.int64], columns: Ints, weights: NDArray[np.float32], width: int) -> None:
        self.indptr, self.columns, self.weights = indptr, columns, weights
        self.shape = (len(indptr) - 1, width)
        self._on_device: dict[torch.device, tuple[Tensor, Tensor, Tensor]] = {}

    def __call__(self, values: Tensor) -> Tensor:
        """Multiply: values (columns, 3), float32 or float64 -> (rows, 3)."""
        return apply_many([self], values)

    def placed(self, device: torch.device) -> tuple[Tensor, Tensor, Tensor]:
        """Every row's entries (rows,), the columns (N,) and the weights (N,) on a device, where they stay.

        That is 8 bytes a tap. A matrix of torch and its transpose have 24, too many for Algorithm 2, which has up to 36
        million taps a camera on a map of 2048 texels.
        """
        if device not in self._on_device:
            entries, columns, weights = np.diff(self.indptr), self.columns, self.weights
            self._on_device[device] = (
                torch.from_numpy(entries).to(device),
                torch.from_numpy(columns).to(device),
                torch.from_numpy(weights).to(device),
            )
        return self._on_device[device]


def apply_many(operators: Sequence[SparseOperator], values: Tensor) -> Tensor:
    """Multiply ``values`` (columns, 3) by several operators and stack the results (sum of rows, 3).

    One call for a whole batch: the backward pass accumulates into a single buffer of texels.
    Half precision is computed, and its gradient accumulated, in float32: fp16 would flush small sums to zero.
    """
    if values.dtype in (torch.float16, torch.bfloat16):
        values = values.float()
    function = _Numba if values.device.type == "cpu" else _Torch
    return function.apply(tuple(operators), values)


class _Numba(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, operators: tuple[SparseOperator, ...], values: Tensor) -> Tensor:
        ctx.operators, ctx.shape = operators, values.shape
        return gather(operators, with_rows(values.detach()).numpy())

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[None, Tensor]:
        result = gradients[0].new_zeros(ctx.shape)
        scatter(ctx.operators, gradients[0], result.numpy())
        return None, result


class _Torch(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, operators: tuple[SparseOperator, ...], values: Tensor) -> Tensor:
        ctx.operators, ctx.shape = operators, values.shape
        products = []
        for operator in operators:
            rows, columns, weights = _entries(operator, values)
            product = values.new_zeros(operator.shape[0], CHANNELS)
            products.append(product.index_add_(0, rows, values[columns] * weights))
        return torch.cat(products)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[None, Tensor]:
        result = gradients[0].new_zeros(ctx.shape)
        parts = gradients[0].split([operator.shape[0] for operator in ctx.operators])
        for operator, part in zip(ctx.operators, parts, strict=True):
            rows, columns, weights = _entries(operator, part)
            result.index_add_(0, columns, part[rows] * weights)
        return None, result


def _entries(operator: SparseOperator, like: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """An operator's N entries on the device of ``like``: rows (N,), columns (N,), and weights (N, 1) in its type."""
    entries, columns, weights = operator.placed(like.device)
    rows = torch.repeat_interleave(entries, output_size=len(columns))
    return rows, columns, weights.to(like)[:, None]


def with_rows(values: Tensor) -> Tensor:
    """Values whose rows lie in memory without gaps, as the kernels read them; rows themselves may lie apart."""
    return values if values.stride(1) == 1 else values.contiguous()


def gather(operators: Sequence[SparseOperator], values: NDArray[np.floating]) -> Tensor:
    """The operators' products with ``values`` (columns, 3 or more), stacked (sum of rows, 3)."""
    result = np.empty((sum(op.shape[0] for op in operators), CHANNELS), values.dtype)
    start = 0
    for op in operators:
        _gather(op.indptr, op.columns, op.weights, values, result[start : start + op.shape[0]])
        start += op.shape[0]
    return torch.from_numpy(result)


def scatter(operators: Sequence[SparseOperator], gradient: Tensor, sums: NDArray[np.floating]) -> None:
    """Add the transposed operators' products with ``gradient`` (sum of rows, 3) to ``sums`` (columns, 3 or more)."""
    source, start = with_rows(gradient).numpy(), 0
    for op in operators:
        _scatter(op.indptr, op.columns, op.weights, source[start : start + op.shape[0]], sums)
        start += op.shape[0]


@intrinsic  # numba passes the first argument itself
def _prefetch(_context: Any, array: Any, row: Any) -> Any:
    """Start to fetch ``array[row]`` of a 2-D array without waiting; ``row`` must lie inside.

    Taps read texels all over a list of tens of megabytes, and a step of the optimizer between two reads has emptied the
    caches: a kernel then waits for memory at every tap. The addresses are known long before, so it asks AHEAD.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array_type, row_type = signature.args
        memory = context.make_array(array_type)(context, builder, arguments[0])
        stride = cgutils.unpack_tuple(builder, memory.strides, 2)[0]
        offset = builder.mul(context.cast(builder, arguments[1], row_type, types.intp), stride)
        place = builder.add(builder.ptrtoint(memory.data, stride.type), offset)
        address, number = builder.inttoptr(place, ir.PointerType(ir.IntType(8))), ir.IntType(32)
        of_type = ir.FunctionType(ir.VoidType(), [address.type, number, number, number])
        instruction = cgutils.get_or_insert_function(builder.module, of_type, "llvm.prefetch.p0")
        builder.call(instruction, [address, number(0), number(3), number(1)])  # to read, into all caches, data
        return context.get_dummy_value()

    return types.void(array, row), generate


prefetch: Any = _prefetch


# Places in arrays are unsigned: of every signed one numba asks whether it counts from the end.
@njit(cache=True, nogil=True)
def _gather(indptr: Any, columns: Any, weights: Any, values: Any, result: Any) -> None:
    last = columns.shape[0] - 1
    for row in range(np.uint64(result.shape[0])):
        red = green = blue = 0.0
        for k in range(np.uint64(indptr[row]), np.uint64(indptr[row + np.uint64(1)])):
            prefetch(values, columns[np.uint64(min(np.int64(k) + AHEAD, last))])
            texel, weight = np.uint32(columns[k]), weights[k]
            red += weight * values[texel, 0]
            green += weight * values[texel, 1]
            blue += weight * values[texel, 2]
        result[row, 0], result[row, 1], result[row, 2] = red, green, blue


@njit(cache=True, nogil=True)
def _scatter(indptr: Any, columns: Any, weights: Any, gradient: Any, sums: Any) -> None:
    last = columns.shape[0] - 1
    for row in range(np.uint64(gradient.shape[0])):
        red, green, blue = gradient[row, 0], gradient[row, 1], gradient[row, 2]
        if red == 0.0 and green == 0.0 and blue == 0.0:
            continue
        for k in range(np.uint64(indptr[row]), np.uint64(indptr[row + np.uint64(1)])):
            prefetch(sums, columns[np.uint64(min(np.int64(k) + AHEAD, last))])
            texel, weight = np.uint32(columns[k]), weights[k]
            sums[texel, 0] += weight * red
            sums[texel, 1] += weight * green
            sums[texel, 2] += weight * blue


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
