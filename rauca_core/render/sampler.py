"""Every renderer of the literature as a choice of taps: how one visible sample reads the UV map."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from ..contract import Camera, Vehicle
from .facets import TEXTURE_SIZE, facet_fragments, onto_pyramid, tensor_traversal, uv_traversal
from .lookup import Fragments, area_fragments, bilinear_fragments, trilinear_fragments
from .mipmap import Pyramid
from .raster.pattern import pattern as subsample_pattern
from .raster.rasterize import Raster
from .sparse import SparseOperator
from .surface import find_surface
from .taps import Taps, filter_view

COARSEST = 1e-3  # thinning at one sample
THINNING = 1e-5  # from 4 x 4 subsamples up: 8 x 8 keep half their taps and 50 dB against Cycles


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


def look_up(
    vehicle: Vehicle,
    raster: Raster,
    pyramid: Pyramid,
    sampler: Sampler = Sampler.AREA,
    texture_size: int = TEXTURE_SIZE,
) -> Fragments:
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
        return area_fragments(vehicle, raster, pyramid)
    paint = vehicle.paint_faces()
    surface = find_surface(raster, paint)
    if sampler == Sampler.BILINEAR:
        return bilinear_fragments(vehicle, surface, pyramid)
    if sampler == Sampler.TRILINEAR:
        return trilinear_fragments(vehicle, surface, pyramid)
    seen = np.zeros(len(paint), bool)
    seen[surface.faces] = True  # cells of other faces are of no use to this view
    inner = facet_operator(vehicle, pyramid, sampler, texture_size, seen)
    found = facet_fragments(vehicle, surface, texture_size, np.cumsum(seen) - 1)
    return replace(found, columns=inner.shape[0], inner=inner)


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


def build_taps(
    vehicle: Vehicle,
    camera_in_vehicle: Camera,
    size: int,
    samples: int = 4,
    filter: str = "blackman-harris",
    pyramid: Pyramid | None = None,
    pattern: str = "lattice",
    thinning: float | None = None,
    sampler: Sampler = Sampler.AREA,
) -> Taps:
    """Compute the taps of one view.

    All faces hide what lies behind them; only paint faces give taps.

    Args:
        vehicle: with its paint mask.
        camera_in_vehicle: the camera in the vehicle's own frame, see ``Frame.camera_in_vehicle``.
        size: side of the UV map, texels.
        samples: a pixel has about ``samples`` x ``samples`` subsamples.
        filter: the pixel filter of the renderer that made the frame, one of ``filters.FILTERS``.
        pyramid: the vehicle's at ``size``, when at hand; built otherwise.
        pattern: how the subsamples lie, one of ``pattern.PATTERNS``.
        thinning: squared weight error that saving one tap is worth, see `thin`; 0 keeps every tap. None takes what
            fits the samples: the fewer they are, the less their taps need to be exact.
        sampler: how a subsample reads the map: ours, or a renderer of the literature, whose taps are not thinned.

    Raises:
        RaucaError: unknown filter or pattern, too many samples, nothing paintable at this size.
    """
    pyramid = pyramid or Pyramid.of(vehicle, size)
    if sampler != Sampler.AREA:
        thinning = 0.0
    elif thinning is None:
        thinning = usual_thinning(samples)

    def look(raster: Raster) -> Fragments:
        return look_up(vehicle, raster, pyramid, sampler)

    return filter_view(vehicle, camera_in_vehicle, pyramid, look, subsample_pattern(samples, pattern), filter, thinning)


def usual_thinning(samples: int) -> float:
    """The price of a tap that fits ``samples`` x ``samples``: its error stays below that of so few samples."""
    return min(THINNING * max(1.0, 4 / samples) ** 6, COARSEST)


@dataclass(frozen=True)
class TapSettings:
    """Taps on the UV map; see :func:`build_taps`."""

    size: int
    samples: int = 12
    filter: str = "blackman-harris"
    pattern: str = "lattice"
    thinning: float | None = None
    sampler: Sampler = Sampler.AREA

    def pyramid(self, vehicle: Vehicle) -> Pyramid:
        return Pyramid.of(vehicle, self.size)

    def build(self, vehicle: Vehicle, camera_in_vehicle: Camera, pyramid: Pyramid) -> Taps:
        return build_taps(vehicle, camera_in_vehicle, pyramid=pyramid, **asdict(self))
