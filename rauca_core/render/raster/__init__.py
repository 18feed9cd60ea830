"""Which face each subsample of an image sees."""

from .pattern import Pattern, pattern
from .rasterize import Raster, rasterize

__all__ = ["Pattern", "Raster", "pattern", "rasterize"]
