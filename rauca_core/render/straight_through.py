"""A picture changed by what has no gradient, such as JPEG; its gradient goes straight through (Bengio et al., 2013)."""

from __future__ import annotations

from typing import Any

from torch import Tensor
from torch.autograd import Function


def straight_through(value: Tensor, changed: Tensor) -> Tensor:
    """``changed`` to the bit; its gradient goes to ``value``, of the same shape, as it is."""
    found: Tensor = _StraightThrough.apply(value, changed)
    return found


class _StraightThrough(Function):
    @staticmethod
    def forward(ctx: Any, value: Tensor, changed: Tensor) -> Tensor:
        return changed.clone()

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        return gradients[0], None
