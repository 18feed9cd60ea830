"""Keeping texels in [0, 1] while Adam moves them: three parametrizations.

``project`` puts them back after each step; every texel keeps its gradient. ``clamp`` clips in the forward pass, as
published; a texel beyond the range has no gradient and can only be brought back by Adam's momentum. ``tanh`` never
leaves the range, and slows down near its ends.
"""

from __future__ import annotations

from typing import Literal, Protocol

import torch
from torch import Tensor

from ..render import saturate

LimitName = Literal["project", "clamp", "tanh"]
FURTHEST = 0.98  # of tanh's range that a start may take: at its ends there is no way back


class Limit(Protocol):
    """Between a free parameter and sRGB values in [0, 1], of any shape."""

    def start(self, values: Tensor) -> Tensor:
        """The parameter that stands for ``values``."""
        ...

    def values(self, parameter: Tensor) -> Tensor:
        """sRGB values in [0, 1], differentiable."""
        ...

    def settle(self, parameter: Tensor) -> None:
        """Mend the parameter in place, after a step."""
        ...


class Project:
    """The parameter is the value."""

    def start(self, values: Tensor) -> Tensor:
        return values.clone()

    def values(self, parameter: Tensor) -> Tensor:
        return saturate(parameter)  # a texel at the very end still has its gradient

    def settle(self, parameter: Tensor) -> None:
        with torch.no_grad():
            parameter.clamp_(0.0, 1.0)


class Clamp(Project):
    """The parameter may leave the range."""

    def settle(self, parameter: Tensor) -> None:
        pass


class Tanh:
    """(tanh + 1) / 2 of the parameter."""

    def start(self, values: Tensor) -> Tensor:
        return torch.atanh((2 * values - 1) * FURTHEST)

    def values(self, parameter: Tensor) -> Tensor:
        return (parameter.tanh() + 1) / 2

    def settle(self, parameter: Tensor) -> None:
        pass


LIMITS: dict[LimitName, Limit] = {"project": Project(), "clamp": Clamp(), "tanh": Tanh()}
