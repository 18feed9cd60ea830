"""What an optimisation varies."""

from __future__ import annotations

from typing import Protocol

import torch
from torch import Tensor

from ..contract.seeding import named_seed
from .limits import LIMITS
from .settings import OptimiserSettings

GREY = 0.5


class Texture(Protocol):
    """A camouflage in the making.

    Attributes:
        parameter: the leaf that Adam moves; its shape is the texture's own business.
    """

    parameter: Tensor

    def texels(self) -> Tensor:
        """The paintable texels (P, 3) of the UV map, sRGB in [0, 1], differentiable with respect to ``parameter``."""
        ...

    def settle(self) -> None:
        """Mend ``parameter`` after a step of Adam."""
        ...


class FreeTexels:
    """Every paintable texel is free, as in RAUCA."""

    def __init__(self, count: int, settings: OptimiserSettings) -> None:
        """``count`` texels, random or plain as the settings say."""
        self._limit = LIMITS[settings.limit]
        self.parameter = self._limit.start(first_texels(count, settings)).requires_grad_()

    def texels(self) -> Tensor:
        return self._limit.values(self.parameter)

    def settle(self) -> None:
        self._limit.settle(self.parameter)


def first_texels(count: int, settings: OptimiserSettings) -> Tensor:
    """Where an optimisation begins: (count, 3) sRGB."""
    if settings.start == "plain":
        return torch.full((count, 3), GREY)
    generator = torch.Generator().manual_seed(named_seed(settings.seed, "start"))
    return torch.rand(count, 3, generator=generator)
