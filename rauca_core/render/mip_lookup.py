"""Lookups of single samples in a pyramid: bilinear at the finest level, and trilinear between two."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..contract import Vehicle
from .fragments import Fragments
from .pyramid import Pyramid
from .surface import Array, Surface, mask_at

Ints = NDArray[np.int64]

_NOTHING = 1e-6  # total weight below which a lookup met no paintable texel


def bilinear_fragments(vehicle: Vehicle, surface: Surface, pyramid: Pyramid) -> Fragments:
    """One bilinear sample of the finest level, whatever the footprint, as PyTorch3D's default. K = 4.

    Texels that are not paintable are dropped and the rest normalised, where the original would read what the gutter
    happens to hold: a favour to this sampler.
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
    starts = np.concatenate([[0], np.cumsum([s.size for s in pyramid.slots])])[:-1]
    uv = uv % 1.0 if wrap else np.clip(uv, 0.0, 1.0)
    texels, weights = np.zeros((len(uv), 4), np.int32), np.zeros((len(uv), 4))
    todo, level = np.arange(len(uv)), level.copy()
    while len(todo):
        side = np.array(pyramid.sizes)[level[todo]][:, None]
        cells, shares = _neighbours(uv[todo], side, wrap)
        places = starts[level[todo]][:, None] + cells[..., 1] * side + cells[..., 0]
        shares = shares * (coverage[places] if by_coverage else coverage[places] > 0)
        total = shares.sum(1, keepdims=True)
        texels[todo] = np.maximum(slots[places], 0)
        weights[todo] = np.where(total > _NOTHING, shares / np.maximum(total, _NOTHING), 0.0)
        todo = todo[total[:, 0] <= _NOTHING]
        level[todo] += 1
        todo, by_coverage = todo[level[todo] < len(pyramid.sizes)], True
    return texels, weights


def _neighbours(uv: Array, side: Ints, wrap: bool) -> tuple[Ints, Array]:
    """Columns and rows (N, 4, 2) of the four texels around each point, and their bilinear weights (N, 4)."""
    point = np.stack([uv[:, 0], 1 - uv[:, 1]], 1) * side - 0.5
    if not wrap:
        point = np.clip(point, 0.0, side - 1.0)
    low = np.floor(point).astype(np.int64)
    offsets = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
    cells = low[:, None, :] + offsets
    cells = cells % side[..., None] if wrap else np.minimum(cells, side[..., None] - 1)
    fraction = (point - low)[:, None, :]
    return cells, np.where(offsets, fraction, 1 - fraction).prod(2)


def _fragments(vehicle: Vehicle, surface: Surface, uv: Array, texels: NDArray[np.int32], weights: Array) -> Fragments:
    paint = mask_at(vehicle.paint_mask, np.clip(uv, 0.0, 1.0))
    return Fragments(surface.index, texels, weights.astype(np.float32), paint * (weights.sum(1) > 0))
