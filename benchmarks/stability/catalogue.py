"""All hard cases of the house, by the part they are hard for."""

from __future__ import annotations

from . import light, loop, losses, rasteriser, renderer
from .checks import Check

FAST: tuple[Check, ...] = (*rasteriser.CHECKS, *renderer.CHECKS, *light.CHECKS, *losses.CHECKS)


def catalogue(steps: int) -> tuple[Check, ...]:
    """Those and the optimiser's, each of these over ``steps`` steps."""
    return (*FAST, *loop.checks(steps))
