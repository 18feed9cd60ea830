"""Which face each subsample of an image sees, compiled for the CPU or in plain torch for any device."""

from .pattern import Pattern, pattern
from .rasterize import Raster, rasterize

__all__ = ["Pattern", "Raster", "pattern", "rasterize"]
