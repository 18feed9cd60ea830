"""One texture on its way to the views of a step, and their gradients on the way back.

All levels of a map of 2048 texels a side are tens of megabytes: clearing a gradient of that size takes longer than
filling in what a view has to say. Here all views of a step add to one buffer, and the pass that hands it down the
levels leaves it clear for the next step. Rows have a fourth number, so that none straddles a cache line.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from .lanes import CHANNELS
from .pyramid import Pyramid, climb, hand_down
from .sparse import SparseOperator, apply_many, gather, scatter, with_rows

ROW = 4  # numbers of a row, the last unused


class Canvas:
    """All mip levels of one texture. What views see is, to the bit, ``apply_many(operators, pyramid(texels))``.

    Attributes:
        ticket: stands between the texels and all views in autograd's graph. On the CPU it is a scalar whose gradient,
            always 0, tells that the gradients of all views lie in the buffer.
    """

    def __init__(self, pyramid: Pyramid, texels_linear: Tensor) -> None:
        """Climb all levels from texels (P, 3) on any device; half precision is computed in float32."""
        self._tensor: Tensor | None = None
        if texels_linear.device.type != "cpu":
            self._tensor = self.ticket = pyramid(texels_linear)
            return
        if texels_linear.dtype in (torch.float16, torch.bfloat16):
            texels_linear = texels_linear.float()
        values = with_rows(texels_linear.detach()).numpy()
        self._levels = np.empty((pyramid.count, ROW), values.dtype)
        climb(values, self._levels, pyramid.tree.parent, pyramid.tree.share)
        self._sums = _Sums(pyramid, values.dtype)
        self.ticket = _Ticket.apply(texels_linear, self._sums)

    def see(self, operators: Sequence[SparseOperator]) -> Tensor:
        """Colors (sum of rows, 3), linear, of several views, stacked."""
        if self._tensor is not None:
            return apply_many(operators, self._tensor)
        pixels: Tensor = _See.apply(self.ticket, tuple(operators), self._levels, self._sums)
        return pixels


class _Sums:
    """The gradient on all levels, summed over the views of one backward pass.

    The buffer is borrowed from the pyramid. One that a failed pass leaves behind is not returned: it is not clear.
    """

    def __init__(self, pyramid: Pyramid, dtype: np.dtype[Any]) -> None:
        self._pyramid, self._dtype = pyramid, dtype
        self._buffer: NDArray[Any] | None = None

    def add(self, operators: Sequence[SparseOperator], gradient: Tensor) -> None:
        if self._buffer is None:
            spare = self._pyramid.spare.pop(self._dtype, None)
            self._buffer = np.zeros((self._pyramid.count, ROW), self._dtype) if spare is None else spare
        scatter(operators, gradient, self._buffer)

    def hand_down(self) -> Tensor:
        """The gradient (P, 3) on the texels; the buffer goes back."""
        buffer, self._buffer = self._buffer, None
        tree, number = self._pyramid.tree, len(self._pyramid.texels)
        if buffer is None:
            return torch.from_numpy(np.zeros((number, CHANNELS), self._dtype))
        texels = np.empty((number, CHANNELS), self._dtype)
        hand_down(buffer, tree.parent, tree.share, texels)
        self._pyramid.spare[self._dtype] = buffer
        return torch.from_numpy(texels)


class _Ticket(torch.autograd.Function):
    """Autograd calls ``backward`` when every view's gradient has arrived."""

    @staticmethod
    def forward(ctx: Any, texels: Tensor, sums: _Sums) -> Tensor:
        ctx.sums = sums
        return texels.new_zeros(())

    @staticmethod
    def backward(ctx: Any, *_gradients: Tensor) -> tuple[Tensor, None]:
        return ctx.sums.hand_down(), None


class _See(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, ticket: Tensor, operators: tuple[SparseOperator, ...], levels: NDArray[Any], sums: _Sums
    ) -> Tensor:
        ctx.operators, ctx.sums = operators, sums
        return gather(operators, levels)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None, None]:
        ctx.sums.add(ctx.operators, gradients[0])
        return gradients[0].new_zeros(()), None, None, None
