"""A fixed sparse linear operator on texels, with its exact adjoint as the gradient."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numba import njit
from numpy.typing import NDArray
from torch import Tensor

from .prefetch import AHEAD, prefetch

Ints = NDArray[np.int32]


class SparseOperator:
    """A (rows, columns) matrix in compressed rows, applied to colours (columns, 3).

    On the CPU, single-threaded numba kernels gather forward and scatter backward: the order of every sum is fixed, so
    results repeat to the bit. On other devices torch multiplies by the matrix and by its transpose, both built once.

    Attributes:
        indptr: (rows + 1,) int64 start of each row.
        columns: (N,) int32.
        weights: (N,) float32.
        shape: (rows, columns).
    """

    def __init__(self, indptr: NDArray[np.int64], columns: Ints, weights: NDArray[np.float32], width: int) -> None:
        self.indptr, self.columns, self.weights = indptr, columns, weights
        self.shape = (len(indptr) - 1, width)
        self._on_device: dict[tuple[torch.device, torch.dtype], tuple[Tensor, Tensor]] = {}

    def __call__(self, values: Tensor) -> Tensor:
        """Multiply: values (columns, 3), float32 or float64 -> (rows, 3)."""
        return apply_many([self], values)

    @cached_property
    def transpose(self) -> SparseOperator:
        """The transposed matrix, its rows sorted by column of the original."""
        counts = np.bincount(self.columns, minlength=self.shape[1])
        indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        order = np.argsort(self.columns, kind="stable")
        row_of = np.repeat(np.arange(self.shape[0], dtype=np.int32), np.diff(self.indptr))
        return SparseOperator(indptr, row_of[order], self.weights[order], self.shape[0])

    def tensors(self, device: torch.device, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
        """The matrix and its transpose as torch CSR tensors, kept per device."""
        key = (device, dtype)
        if key not in self._on_device:
            ordered = self.transpose.transpose  # torch wants sorted columns; rows are merged in order of visit
            self._on_device[key] = (ordered._tensor(device, dtype), self.transpose._tensor(device, dtype))
        return self._on_device[key]

    def _tensor(self, device: torch.device, dtype: torch.dtype) -> Tensor:
        parts = (torch.from_numpy(self.indptr), torch.from_numpy(self.columns.astype(np.int64)))
        weights = torch.from_numpy(self.weights).to(dtype)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Sparse CSR tensor support is in beta", UserWarning)
            return torch.sparse_csr_tensor(*parts, weights, size=self.shape, device=device, check_invariants=True)


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
        result = values.new_empty((sum(op.shape[0] for op in operators), values.shape[1]))
        source, target, start = values.detach().contiguous().numpy(), result.numpy(), 0
        for op in operators:
            _gather(op.indptr, op.columns, op.weights, source, target[start : start + op.shape[0]])
            start += op.shape[0]
        return result

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[None, Tensor]:
        gradient = gradients[0].contiguous()
        result = gradient.new_zeros(ctx.shape)
        source, target, start = gradient.numpy(), result.numpy(), 0
        for op in ctx.operators:
            _scatter(op.indptr, op.columns, op.weights, source[start : start + op.shape[0]], target)
            start += op.shape[0]
        return None, result


class _Torch(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, operators: tuple[SparseOperator, ...], values: Tensor) -> Tensor:
        ctx.operators = operators
        return torch.cat([op.tensors(values.device, values.dtype)[0] @ values for op in operators])

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[None, Tensor]:
        parts = gradients[0].split([op.shape[0] for op in ctx.operators])
        pairs = zip(ctx.operators, parts, strict=True)
        return None, torch.stack([op.tensors(g.device, g.dtype)[1] @ g for op, g in pairs]).sum(0)


@njit(cache=True, nogil=True)
def _gather(indptr: Any, columns: Any, weights: Any, values: Any, result: Any) -> None:
    last = columns.shape[0] - 1
    for row in range(result.shape[0]):
        red = green = blue = 0.0
        for k in range(indptr[row], indptr[row + 1]):
            prefetch(values, columns[min(k + AHEAD, last)])
            weight, texel = weights[k], columns[k]
            red += weight * values[texel, 0]
            green += weight * values[texel, 1]
            blue += weight * values[texel, 2]
        result[row, 0], result[row, 1], result[row, 2] = red, green, blue


@njit(cache=True, nogil=True)
def _scatter(indptr: Any, columns: Any, weights: Any, gradient: Any, result: Any) -> None:
    last = columns.shape[0] - 1
    for row in range(gradient.shape[0]):
        red, green, blue = gradient[row, 0], gradient[row, 1], gradient[row, 2]
        if red == 0.0 and green == 0.0 and blue == 0.0:
            continue  # NaN is not equal to zero, so it is passed on
        for k in range(indptr[row], indptr[row + 1]):
            prefetch(result, columns[min(k + AHEAD, last)])
            weight, texel = weights[k], columns[k]
            result[texel, 0] += weight * red
            result[texel, 1] += weight * green
            result[texel, 2] += weight * blue
