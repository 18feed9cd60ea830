"""All hard cases of the house, by the part they are hard for."""

from __future__ import annotations

from . import light, loop, losses, rasterizer, renderer
from .checks import Check

FAST: tuple[Check, ...] = (*rasterizer.CHECKS, *renderer.CHECKS, *light.CHECKS, *losses.CHECKS)


def catalogue(steps: int) -> tuple[Check, ...]:
    """Those and the optimizer's, each of these over ``steps`` steps."""
    return (*FAST, *loop.checks(steps))
