"""The neural renderer: visibility once per view, then texture to pixels as one sparse linear operator."""

from .cache import TapCache, TapSettings
from .composite import composite, display, undisplay
from .pyramid import Pyramid
from .raster.rasterise import Raster, rasterize
from .sampling import Sampler
from .sparse import SparseOperator, apply_many
from .taps import FORMAT as TAP_FORMAT
from .taps import Taps, build_taps

__all__ = [
    "TAP_FORMAT",
    "Pyramid",
    "Raster",
    "Sampler",
    "SparseOperator",
    "TapCache",
    "TapSettings",
    "Taps",
    "apply_many",
    "build_taps",
    "composite",
    "display",
    "rasterize",
    "undisplay",
]
