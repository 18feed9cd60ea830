"""Step 7: carry the camouflage to another UV layout."""

from __future__ import annotations

from . import operators
from .panel import RAUCA_PT_bake, RaucaBake, state

CLASSES = (RaucaBake, *operators.CLASSES, RAUCA_PT_bake)

__all__ = ["CLASSES", "RaucaBake", "state"]
