"""The neural renderer: visibility once per view, then texture to pixels as one sparse linear operator."""

from .cache import TapCache, TapRecipe
from .composite import composite, linear_to_srgb, saturate, srgb_to_linear
from .facets import FacetSettings, bake_facets, cell_positions
from .mipmap import MipmappedTexture, Pyramid
from .raster.rasterize import Raster, rasterize
from .sampler import Sampler, TapSettings, build_taps
from .sparse import SparseOperator, apply_many
from .taps import TAP_FORMAT, Taps
from .world_aligned import PatternSettings, pattern_pyramid, project_pattern

__all__ = [
    "TAP_FORMAT",
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
    "cell_positions",
    "composite",
    "linear_to_srgb",
    "pattern_pyramid",
    "project_pattern",
    "rasterize",
    "saturate",
    "srgb_to_linear",
]
