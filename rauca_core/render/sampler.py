"""Every renderer of the literature as a choice of taps: how one visible sample reads the UV map."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from ..contract import Vehicle
from .facets import facet_fragments, onto_pyramid, tensor_traversal, uv_traversal
from .lookup import Fragments, area_fragments, bilinear_fragments, trilinear_fragments
from .mipmap import Pyramid
from .raster.rasterize import Raster
from .sparse import SparseOperator
from .surface import find_surface

TEXTURE_SIZE = 6  # ts of T_fc in DAS, FCA and the paper's published code


class Sampler(StrEnum):
    """How a visible sample of a paint face reads the UV map.

    Attributes:
        AREA: bilinear in the mip level of the sample's own footprint; many samples make a pixel. This project's.
        BILINEAR: bilinear in the finest level, whatever the footprint: the default of PyTorch3D, and nvdiffrast's
            "linear" mode.
        TRILINEAR: isotropic mip mapping, interpolated between two levels: nvdiffrast's "linear-mipmap-linear".
        TENSOR_TRAVERSAL: the paper's Algorithm 1, which fills the facet texture tensor of Neural Renderer by sampling
            the map once per cell; DAS and FCA optimize that tensor itself.
        UV_TRAVERSAL: the paper's Algorithm 2, which shares every texel out among the tensor's cells: RAUCA-final.
    """

    AREA = "area"
    BILINEAR = "bilinear"
    TRILINEAR = "trilinear"
    TENSOR_TRAVERSAL = "tensor-traversal"
    UV_TRAVERSAL = "uv-traversal"

    @property
    def through_facets(self) -> bool:
        """Whether pixels read the facet texture tensor, not the map."""
        return self in (Sampler.TENSOR_TRAVERSAL, Sampler.UV_TRAVERSAL)


@dataclass(frozen=True, eq=False)
class Lookup:
    """What the samples of one view read.

    Attributes:
        fragments: of the painted samples; their "texels" are places in a list of ``columns`` values.
        columns: length of that list: the pyramid's texels, or the cells of the visible faces.
        inner: None, or the operator (columns, T) from the pyramid's texels to the cells. Its rows sum to 1, or are
            empty for black cells: `sparse.compose` puts it behind the rows of the pixels.
    """

    fragments: Fragments
    columns: int
    inner: SparseOperator | None = None


def look_up(
    vehicle: Vehicle,
    raster: Raster,
    pyramid: Pyramid,
    sampler: Sampler = Sampler.AREA,
    texture_size: int = TEXTURE_SIZE,
) -> Lookup:
    """Find what every painted sample of a view reads.

    Args:
        vehicle: with its paint mask.
        raster: of the vehicle.
        pyramid: of the vehicle's atlas.
        sampler: which renderer's lookup.
        texture_size: ts of the facet texture tensor, for the two samplers that pass through it.

    Raises:
        RaucaError: a texture size below 2, or so large that the cells cannot be counted.
    """
    if sampler == Sampler.AREA:
        return Lookup(area_fragments(vehicle, raster, pyramid), pyramid.count)
    paint = vehicle.paint_faces()
    surface = find_surface(raster, paint)
    if sampler == Sampler.BILINEAR:
        return Lookup(bilinear_fragments(vehicle, surface, pyramid), pyramid.count)
    if sampler == Sampler.TRILINEAR:
        return Lookup(trilinear_fragments(vehicle, surface, pyramid), pyramid.count)
    seen = np.zeros(len(paint), bool)
    seen[surface.faces] = True  # cells of other faces are of no use to this view
    inner = facet_operator(vehicle, pyramid, sampler, texture_size, seen)
    rank = np.cumsum(seen) - 1
    return Lookup(facet_fragments(vehicle, surface, texture_size, rank), inner.shape[0], inner)


def facet_operator(
    vehicle: Vehicle,
    pyramid: Pyramid,
    sampler: Sampler,
    texture_size: int = TEXTURE_SIZE,
    faces: NDArray[np.bool_] | None = None,
) -> SparseOperator:
    """From the pyramid's texels to the cells of ``faces`` (F,), paint faces in ascending order; all of them if None."""
    paint = vehicle.paint_faces()
    chosen = paint if faces is None else paint & faces
    uvs = vehicle.uvs[paint]
    place = np.flatnonzero(chosen[paint])
    if sampler == Sampler.TENSOR_TRAVERSAL:
        cells = tensor_traversal(uvs[place], pyramid.size, texture_size)
    else:
        cells = uv_traversal(uvs, pyramid.size, texture_size, faces=place)
    return onto_pyramid(cells, pyramid)
