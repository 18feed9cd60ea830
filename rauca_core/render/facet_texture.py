"""The facet texture tensor T_fc as the texture itself, the way DAS and FCA optimize it.

A view reads the cells of the faces it sees, as Neural Renderer does; there is no UV map in between. To deploy such a
texture it is baked: every texel of the atlas reads the cells of the face under it.

Not here: what `facets` computes, the cells as a function of a UV map.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..contract import Camera, Vehicle
from .facets import cell_points, check_texture_size, facet_fragments
from .mipmap import Pyramid
from .onto_atlas import read_on_atlas
from .raster.pattern import pattern
from .raster.rasterize import Raster
from .sampler import TEXTURE_SIZE, Lookup
from .sparse import SparseOperator
from .surface import Array, Surface, find_surface
from .taps import Taps, filter_view


def cells_pyramid(vehicle: Vehicle, texture_size: int = TEXTURE_SIZE) -> Pyramid:
    """The cells of the paint faces as a list without coarser levels; cell c of paint face m is m * ts^3 + c.

    Raises:
        RaucaError: a texture size below 2, or so large that the cells cannot be counted.
    """
    faces = int(vehicle.paint_faces().sum())
    check_texture_size(faces, texture_size)
    count = faces * texture_size**3
    side = math.isqrt(count) | 1  # odd: nothing to halve
    side += 2 * (side**2 < count)
    return Pyramid((np.arange(side**2) < count).astype(np.float32).reshape(side, side))


@dataclass(frozen=True)
class FacetSettings:
    """Taps on the cells; samples and filter as in `build_taps`. The defaults are Neural Renderer's: 2 x 2, averaged."""

    samples: int = 2
    filter: str = "box"
    texture_size: int = TEXTURE_SIZE

    def pyramid(self, vehicle: Vehicle) -> Pyramid:
        return cells_pyramid(vehicle, self.texture_size)

    def build(self, vehicle: Vehicle, camera_in_vehicle: Camera, pyramid: Pyramid) -> Taps:
        """The taps of one view from the cells of :func:`cells_pyramid`.

        Raises:
            RaucaError: unknown filter, too many samples.
        """

        def look(raster: Raster) -> Lookup:
            surface = find_surface(raster, vehicle.paint_faces())
            return Lookup(facet_fragments(vehicle, surface, self.texture_size, _ranks(vehicle)), pyramid.count)

        return filter_view(vehicle, camera_in_vehicle, pyramid, look, pattern(self.samples), self.filter)


def bake_facets(vehicle: Vehicle, atlas: Pyramid, cells: Pyramid, texture_size: int = TEXTURE_SIZE) -> SparseOperator:
    """From the cells to the paintable texels of the UV atlas: the facet texture as a UV map.

    What is lost: a texel on the seam of two faces is the mean of both; views then filter texels, not cells.

    Raises:
        RaucaError: an atlas of another vehicle.
    """
    ranks = _ranks(vehicle)

    def look(surface: Surface) -> tuple[NDArray[np.int32], Array]:
        found = facet_fragments(vehicle, surface, texture_size, ranks)
        return found.texels, found.weights.astype(np.float64)

    return read_on_atlas(vehicle, atlas, cells, look)


def cell_positions(vehicle: Vehicle, texture_size: int = TEXTURE_SIZE) -> NDArray[np.float32]:
    """Where on the body each cell lies, metres: (paint faces * ts^3, 3), in the vehicle's frame.

    The cell (0, 0, 0), which stands for no point, is put at the face's center.
    """
    points = cell_points(texture_size)
    points[points.sum(1) == 0] = 1 / 3
    corners = vehicle.positions[vehicle.triangles[vehicle.paint_faces()]]
    return np.einsum("ck,fkd->fcd", points.astype(np.float32), corners).reshape(-1, 3)


def _ranks(vehicle: Vehicle) -> NDArray[np.int64]:
    """(F,) place of each face among the paint faces."""
    return np.asarray(np.cumsum(vehicle.paint_faces()) - 1, np.int64)
