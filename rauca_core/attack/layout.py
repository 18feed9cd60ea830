"""What is painted: the UV map itself, the facet texture tensor, or one pattern that repeats all over the vehicle.

Views read a list of colors through taps; the layout says which list. Every layout ends as a UV map, so that Blender
can show it: free texels are one already, facets are baked, a pattern is projected.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from pathlib import Path

from torch import Tensor

from ..contract import Vehicle
from ..render import (
    FacetSettings,
    PatternSettings,
    Pyramid,
    SparseOperator,
    TapCache,
    TapRecipe,
    TapSettings,
    bake_facets,
    linear_to_srgb,
    project_pattern,
    srgb_to_linear,
)
from .settings import OptimizerSettings


class PaintLayout:
    """A list of colors that views read.

    Attributes:
        taps: of every view, on that list and its mip levels.
        atlas: the paintable texels of the UV map.
    """

    def __init__(self, taps: TapCache, atlas: Pyramid, bake: Callable[[], SparseOperator] | None = None) -> None:
        """``bake`` makes the operator from the list's levels to the atlas's texels; None where the list is these."""
        self.taps, self.atlas, self._bake = taps, atlas, bake

    @property
    def count(self) -> int:
        """How many colors the list holds."""
        return len(self.taps.pyramid.texels)

    @cached_property
    def _operator(self) -> SparseOperator | None:
        return None if self._bake is None else self._bake()

    def on_map(self, colors: Tensor) -> Tensor:
        """Colors (N, 3) sRGB of the list as texels (P, 3) sRGB of the UV map, differentiable; means are of light."""
        if self._operator is None:
            return colors
        return linear_to_srgb(self._operator(self.taps.pyramid(srgb_to_linear(colors))))


def make_layout(vehicle: Vehicle, settings: OptimizerSettings, folder: Path, memory_bytes: int) -> PaintLayout:
    """The layout of a run.

    Args:
        folder: where taps are cached; ``memory_bytes`` of them are kept in memory.

    Raises:
        RaucaError: nothing paintable at the map's size.
    """
    samples, pixel_filter = settings.samples, settings.pixel_filter

    def cache(recipe: TapRecipe) -> TapCache:
        return TapCache(folder, vehicle, recipe, memory_bytes)

    if settings.paint == "texels":
        taps = cache(TapSettings(settings.map_size, samples, pixel_filter, sampler=settings.sampler))
        return PaintLayout(taps, taps.pyramid)
    atlas = Pyramid.of(vehicle, settings.map_size)
    if settings.paint == "facets":
        taps = cache(FacetSettings(samples, pixel_filter, settings.texture_size))
        return PaintLayout(taps, atlas, lambda: bake_facets(vehicle, atlas, taps.pyramid, settings.texture_size))
    taps = cache(PatternSettings(settings.pattern_side, settings.tile_m, samples, pixel_filter))
    return PaintLayout(taps, atlas, lambda: project_pattern(vehicle, atlas, taps.pyramid, settings.tile_m))
