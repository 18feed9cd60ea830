"""Lookups of single samples in a pyramid: bilinear at the finest level, and trilinear between two."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...contract import Vehicle
from ..kernels import njit
from ..mipmap import Pyramid
from .fragments import Fragments
from .surface import Array, Surface, mask_at

Ints = NDArray[np.int64]

_NOTHING = 1e-6  # total weight below which a lookup met no paintable texel


def bilinear_fragments(vehicle: Vehicle, surface: Surface, pyramid: Pyramid) -> Fragments:
    """One bilinear sample of the finest level, whatever the footprint, as PyTorch3D's default. K = 4.

    Texels that are not paintable are dropped and the rest normalized, where the original would read what the gutter
    happens to hold: a favor to this sampler.
    """
    uv = surface.interpolate(vehicle.uvs)
    texels, weights = read_level(pyramid, np.zeros(len(uv), np.int64), uv, by_coverage=False)
    return _fragments(vehicle, surface, uv, texels, weights)


def trilinear_fragments(vehicle: Vehicle, surface: Surface, pyramid: Pyramid) -> Fragments:
    """Bilinear samples of the two mip levels around the sample's footprint, interpolated. K = 8.

    As nvdiffrast ("linear-mipmap-linear"), the level is log2 of the *longest* axis of the footprint in texels; the
    footprint is that of the samples drawn, so of the whole pixel where there is one per pixel. The pyramid is ours,
    weighted by coverage, where the original mixes gutters into its coarse levels.
    """
    uv = surface.interpolate(vehicle.uvs)
    blur = np.log2(np.maximum(longest_axis(surface.differentiate(vehicle.uvs)) * pyramid.size, 1e-9))
    blur = np.clip(blur, 0.0, len(pyramid.sizes) - 1.0)
    fine = np.minimum(blur.astype(np.int64), max(len(pyramid.sizes) - 2, 0))
    coarse, share = np.minimum(fine + 1, len(pyramid.sizes) - 1), (blur - fine)[:, None]
    near, near_weights = read_level(pyramid, fine, uv)
    far, far_weights = read_level(pyramid, coarse, uv)
    weights = np.concatenate([near_weights * (1 - share), far_weights * share], 1)
    return _fragments(vehicle, surface, uv, np.concatenate([near, far], 1), weights)


def longest_axis(jacobian: Array) -> Array:
    """Largest singular value (N,) of 2x2 matrices (N, 2, 2): the longest axis of a footprint."""
    square = (jacobian**2).sum((1, 2))
    area = jacobian[:, 0, 0] * jacobian[:, 1, 1] - jacobian[:, 0, 1] * jacobian[:, 1, 0]
    root = np.sqrt(np.maximum(square**2 - 4 * area**2, 0.0))
    return np.asarray(np.sqrt(0.5 * (square + root)))


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
    slots = np.concatenate([s.ravel() for s in pyramid.slots])
    coverage = np.concatenate([c.ravel() for c in pyramid.coverage])
    starts = np.concatenate([[0], np.cumsum([s.size for s in pyramid.slots])])
    texels, weights = np.zeros((len(uv), 4), np.int32), np.zeros((len(uv), 4))
    _read(slots, coverage, starts, np.array(pyramid.sizes), level, uv, wrap, by_coverage, texels, weights)
    return texels, weights


@njit(cache=True, nogil=True)
def _read(
    slots: Any,
    coverage: Any,
    starts: Any,
    sizes: Any,
    level: Any,
    uv: Any,
    wrap: bool,
    by_coverage: bool,
    texels: Any,
    weights: Any,
) -> None:
    for n in range(uv.shape[0]):
        for k in range(level[n], sizes.shape[0]):
            side, total = sizes[k], 0.0
            x, y = uv[n, 0] * side - 0.5, (1.0 - uv[n, 1]) * side - 0.5
            if not wrap:
                x, y = min(max(x, 0.0), side - 1.0), min(max(y, 0.0), side - 1.0)
            left, top = int(np.floor(x)), int(np.floor(y))
            for i in range(4):
                column, row = left + i % 2, top + i // 2
                weight = (x - left if i % 2 else 1.0 - (x - left)) * (y - top if i // 2 else 1.0 - (y - top))
                column = column % side if wrap else min(column, side - 1)
                row = row % side if wrap else min(row, side - 1)
                place = starts[k] + row * side + column
                if by_coverage or k > level[n]:
                    weight *= coverage[place]
                elif slots[place] < 0:
                    weight = 0.0
                texels[n, i], weights[n, i] = max(slots[place], 0), weight
                total += weight
            if total > _NOTHING:
                weights[n] /= total
                break
            weights[n] = 0.0


def _fragments(vehicle: Vehicle, surface: Surface, uv: Array, texels: NDArray[np.int32], weights: Array) -> Fragments:
    paint = mask_at(vehicle.paint_mask, np.clip(uv, 0.0, 1.0))
    return Fragments(surface.index, texels, weights.astype(np.float32), paint * (weights.sum(1) > 0))
