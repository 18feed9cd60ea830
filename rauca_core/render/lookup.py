"""From visible samples to texels: which texels each fragment reads, and how much paint it shows.

Three lookups in the mip pyramid: this project's, and the two of the literature that read the map itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contract import Vehicle
from ..runtime.kernels import njit
from .mipmap import Pyramid
from .raster.pattern import PLACES
from .raster.rasterize import Raster
from .sparse import SparseOperator
from .surface import Array, Surface, bilinear_mask, mask_at

Ints = NDArray[np.int64]

TEXELS = 4  # a bilinear lookup in one mip level
_NOTHING = 1e-6  # total weight below which a lookup met no paintable texel


@dataclass(frozen=True, eq=False)
class Fragments:
    """What the painted samples of one view read.

    Attributes:
        index: (h, w) int32 over the raster's window, the fragment of a sample or -1.
        texels: (N, K) int32 places in a list of ``columns`` values; unused ones have weight 0.
        weights: (N, K) float32, each row sums to 1.
        paint: (N,) float32 paint mask in [0, 1] at the fragment.
        columns: length of that list: the pyramid's texels, or the cells of faces.
        inner: None, or the operator (columns, T) from the pyramid's texels to the cells. Its rows sum to 1, or are
            empty for black cells: `sparse.compose` puts it behind the rows of the pixels.
    """

    index: NDArray[np.int32]
    texels: NDArray[np.int32]
    weights: NDArray[np.float32]
    paint: NDArray[np.float32]
    columns: int
    inner: SparseOperator | None = None


def area_fragments(vehicle: Vehicle, raster: Raster, pyramid: Pyramid) -> Fragments:
    """Bilinear in the mip level of the sample's own footprint, this project's. K = 4, or 16 where samples are few.

    The mip level is the one whose texels are about as large as the footprint of one lookup. Visibility needs many
    samples, texture many lookups: where samples are few, each looks at 2 x 2 places of its square, within its face. UVs
    are clamped to the map; faces without area in the atlas read one texel at the finest level.
    """
    visible = raster.face_ids >= 0
    painted = np.zeros_like(visible)
    painted[visible] = vehicle.paint_faces()[raster.face_ids[visible]]
    index = np.full(raster.face_ids.shape, -1, np.int32)
    number = int(painted.sum())
    index[painted] = np.arange(number, dtype=np.int32)
    pattern = raster.pattern
    probes = 1 if pattern.number >= PLACES else 2
    fragments = Fragments(
        index,
        np.zeros((number, TEXELS * probes**2), np.int32),
        np.zeros((number, TEXELS * probes**2), np.float32),
        np.zeros(number, np.float32),
        pyramid.count,
    )
    _look_up(
        (index, raster.face_ids, raster.planes),
        (raster.x0, raster.y0, raster.margin, pattern.columns, pattern.shifts),
        pattern.side / probes,
        (vehicle.uvs.astype(np.float64), vehicle.paint_mask),
        pyramid.flat,
        probes,
        (fragments.texels, fragments.weights, fragments.paint),
    )
    return fragments


@njit(cache=True, nogil=True)
def _look_up(seen: Any, place: Any, side: float, surface: Any, levels: Any, probes: int, found: Any) -> None:
    index, face_ids, planes = seen
    x0, y0, margin, columns, shifts = place
    uvs, mask = surface
    texels, weights, paint = found
    finest, rows = levels[3][0], shifts.shape[0]
    for row in range(index.shape[0]):
        for column in range(index.shape[1]):
            n = index[row, column]
            if n < 0:
                continue
            face = face_ids[row, column]
            x = (x0 + column + shifts[(y0 + row) % rows]) / columns - margin
            y = (y0 + row + 0.5) / rows - margin
            u, v, footprint = _texture_coordinates(planes[face], uvs[face], x, y)
            paint[n] = bilinear_mask(mask, u, v)
            met = 0
            for k in range(probes * probes):
                if probes > 1:
                    across, down = k % probes - 0.5 * (probes - 1), k // probes - 0.5 * (probes - 1)
                    place = x + across * side, y + down * side
                    u, v, footprint = _texture_coordinates(planes[face], uvs[face], place[0], place[1])
                level = min(max(int(np.rint(np.log2(max(footprint * side * finest, 1e-9)))), 0), len(levels[3]) - 1)
                four = slice(TEXELS * k, TEXELS * (k + 1))
                met += _read(levels, level, u, v, False, True, texels[n, four], weights[n, four])
            if met == 0:
                paint[n] = 0.0
            if met > 1:
                for k in range(weights.shape[1]):
                    weights[n, k] /= met


@njit(cache=True, nogil=True)
def _texture_coordinates(plane: Any, uv: Any, x: float, y: float) -> tuple[float, float, float]:
    """u, v in [0, 1] at pixel coordinates, and the side of a pixel's footprint in units of the map."""
    total = u = v = ux = uy = vx = vy = dx = dy = 0.0
    for k in range(3):
        over_depth = max(plane[0, k] * x + plane[1, k] * y + plane[2, k], 0.0)
        total += over_depth
        u += over_depth * uv[k, 0]
        v += over_depth * uv[k, 1]
        dx += plane[0, k]
        dy += plane[1, k]
        ux += plane[0, k] * uv[k, 0]
        uy += plane[1, k] * uv[k, 0]
        vx += plane[0, k] * uv[k, 1]
        vy += plane[1, k] * uv[k, 1]
    total = max(total, 1e-300)
    u, v = u / total, v / total
    ux, uy, vx, vy = (ux - u * dx) / total, (uy - u * dy) / total, (vx - v * dx) / total, (vy - v * dy) / total
    area, square = abs(ux * vy - uy * vx), ux * ux + uy * uy + vx * vx + vy * vy
    longest = np.sqrt(0.5 * (square + np.sqrt(max(square * square - 4.0 * area * area, 0.0))))
    # The square of equal area. Where that is so long that bilinear lookups would leap over texels, wide enough not to:
    # every texel that a view shows then has a tap, which seen at a grazing angle it had not.
    footprint = max(np.sqrt(area), 0.5 * longest)
    return min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0), footprint


def bilinear_fragments(vehicle: Vehicle, surface: Surface, pyramid: Pyramid) -> Fragments:
    """One bilinear sample of the finest level, whatever the footprint, as PyTorch3D's default. K = 4.

    Texels that are not paintable are dropped and the rest normalized, where the original would read what the gutter
    happens to hold: a favor to this sampler.
    """
    uv = surface.interpolate(vehicle.uvs)
    texels, weights = read_level(pyramid, np.zeros(len(uv), np.int64), uv, by_coverage=False)
    return _fragments(vehicle, surface, pyramid, uv, texels, weights)


def trilinear_fragments(vehicle: Vehicle, surface: Surface, pyramid: Pyramid) -> Fragments:
    """Bilinear samples of the two mip levels around the sample's footprint, interpolated. K = 8.

    As nvdiffrast ("linear-mipmap-linear"), the level is log2 of the *longest* axis of the footprint in texels; the
    footprint is that of the samples drawn, so of the whole pixel where there is one per pixel. The pyramid is ours,
    weighted by coverage, where the original mixes gutters into its coarse levels.
    """
    uv = surface.interpolate(vehicle.uvs)
    jacobian = surface.differentiate(vehicle.uvs)
    square = (jacobian**2).sum((1, 2))
    area = jacobian[:, 0, 0] * jacobian[:, 1, 1] - jacobian[:, 0, 1] * jacobian[:, 1, 0]
    longest = np.sqrt(0.5 * (square + np.sqrt(np.maximum(square**2 - 4 * area**2, 0.0))))  # the largest singular value
    blur = np.log2(np.maximum(longest * pyramid.size, 1e-9))
    blur = np.clip(blur, 0.0, len(pyramid.sizes) - 1.0)
    fine = np.minimum(blur.astype(np.int64), max(len(pyramid.sizes) - 2, 0))
    coarse, share = np.minimum(fine + 1, len(pyramid.sizes) - 1), (blur - fine)[:, None]
    near, near_weights = read_level(pyramid, fine, uv)
    far, far_weights = read_level(pyramid, coarse, uv)
    weights = np.concatenate([near_weights * (1 - share), far_weights * share], 1)
    return _fragments(vehicle, surface, pyramid, uv, np.concatenate([near, far], 1), weights)


def _fragments(
    vehicle: Vehicle, surface: Surface, pyramid: Pyramid, uv: Array, texels: NDArray[np.int32], weights: Array
) -> Fragments:
    paint = mask_at(vehicle.paint_mask, np.clip(uv, 0.0, 1.0)) * (weights.sum(1) > 0)
    return Fragments(surface.index, texels, weights.astype(np.float32), paint, pyramid.count)


def read_level(
    pyramid: Pyramid, level: Ints, uv: Array, wrap: bool = False, by_coverage: bool = True
) -> tuple[NDArray[np.int32], Array]:
    """Bilinear lookup in one level per sample.

    Where none of the four texels is paintable the next coarser level is read, which reaches further.

    Args:
        level: (N,) of each sample.
        uv: (N, 2) map coordinates, u right, v up.
        wrap: repeat the map beyond [0, 1]; otherwise coordinates are clamped to it.
        by_coverage: weigh texels by their paintable share; otherwise all paintable texels alike.

    Returns:
        texels (N, 4) in the pyramid's list and weights (N, 4) float64 whose rows sum to 1, or to 0 where not even the
        coarsest level holds paint nearby.
    """
    texels, weights = np.zeros((len(uv), TEXELS), np.int32), np.zeros((len(uv), TEXELS))
    _read_all(pyramid.flat, level, uv, wrap, by_coverage, texels, weights)
    return texels, weights


@njit(cache=True, nogil=True)
def _read_all(levels: Any, level: Any, uv: Any, wrap: bool, by_coverage: bool, texels: Any, weights: Any) -> None:
    for n in range(uv.shape[0]):
        _read(levels, level[n], uv[n, 0], uv[n, 1], wrap, by_coverage, texels[n], weights[n])


@njit(cache=True, nogil=True)
def _read(
    levels: Any, level: int, u: float, v: float, wrap: bool, by_coverage: bool, texels: Any, weights: Any
) -> bool:
    """One such lookup, into ``texels`` (4,) and ``weights`` (4,); False where nothing paintable lies near."""
    slots, coverage, starts, sizes = levels
    for k in range(level, sizes.shape[0]):
        side, total = sizes[k], 0.0
        x, y = u * side - 0.5, (1.0 - v) * side - 0.5
        if not wrap:
            x, y = min(max(x, 0.0), side - 1.0), min(max(y, 0.0), side - 1.0)
        left, top = int(np.floor(x)), int(np.floor(y))
        fx, fy = x - left, y - top
        for i in range(TEXELS):
            column, row = left + i % 2, top + i // 2
            column = column % side if wrap else min(column, side - 1)
            row = row % side if wrap else min(row, side - 1)
            place = starts[k] + row * side + column
            weight = (fx if i % 2 else 1.0 - fx) * (fy if i // 2 else 1.0 - fy)
            if by_coverage or k > level:
                weight *= coverage[place]
            elif slots[place] < 0:
                weight = 0.0
            texels[i], weights[i] = max(slots[place], 0), weight
            total += weight
        if total > _NOTHING:
            for i in range(TEXELS):
                weights[i] /= total
            return True
        weights[:] = 0
    return False
