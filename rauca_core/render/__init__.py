"""The neural renderer: visibility once per view, then texture to pixels as one sparse linear operator."""

from .cache import FacetSettings, PatternSettings, TapCache, TapRecipe, TapSettings
from .composite import composite, linear_to_srgb, saturate, srgb_to_linear
from .facet_texture import bake_facets, cell_positions
from .mipmap import MipmappedTexture, Pyramid
from .raster.rasterize import Raster, rasterize
from .sampler import Sampler
from .sparse import SparseOperator, apply_many
from .taps import Taps, build_taps, tap_format
from .world_aligned import build_world_aligned_taps, pattern_pyramid, project_pattern

__all__ = [
    "FacetSettings",
    "MipmappedTexture",
    "PatternSettings",
    "Pyramid",
    "Raster",
    "Sampler",
    "SparseOperator",
    "TapCache",
    "TapRecipe",
    "TapSettings",
    "Taps",
    "apply_many",
    "bake_facets",
    "build_taps",
    "build_world_aligned_taps",
    "cell_positions",
    "composite",
    "linear_to_srgb",
    "pattern_pyramid",
    "project_pattern",
    "rasterize",
    "saturate",
    "srgb_to_linear",
    "tap_format",
]
