"""What is wrong with the UVs of the paint: as a verdict for the import, and face by face for the artist."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core import geometry

OVERLAP_LIMIT = 0.02  # of the covered texels; more than stray slivers, and one texel would paint two places
CHECK_ATLAS = 1024
BEYOND = 1e-3  # of the texture's side; less is rounding
DENSITY_RATIO = 2.0  # times finer or coarser than the paint's median: the pattern visibly changes its size


@dataclass(frozen=True)
class UvFaults:
    """Faulty paint faces, each (F_paint,) bool.

    Attributes:
        missing: no UVs, or no area in the texture.
        outside: reaching beyond the border of the texture, or lying in another tile of it.
        overlapping: sharing a texel with another face.
        uneven: texels more than ``DENSITY_RATIO`` times finer or coarser than the paint's median by area.
    """

    missing: NDArray[np.bool_]
    outside: NDArray[np.bool_]
    overlapping: NDArray[np.bool_]
    uneven: NDArray[np.bool_]


def uv_faults(uvs: NDArray[np.float32], area: NDArray[np.float64]) -> UvFaults:
    """Judge the UVs (F_paint, 3, 2) of faces with ``area`` (F_paint,) on the surface, square metres."""
    finite = np.isfinite(uvs).all(axis=(1, 2))
    clean = np.where(finite[:, None, None], uvs, 0.0).astype(np.float64)
    uv_area = np.abs(geometry.signed_uv_area(clean))
    solid = area > 1e-12
    missing = ~finite | (solid & (uv_area < 1e-12))
    outside = finite & ((clean < -BEYOND) | (clean > 1 + BEYOND)).any(axis=(1, 2))
    moved, _ = _in_tile(clean)
    texels, faces = geometry.covered(moved, CHECK_ATLAS, conservative=False)
    shared = np.bincount(texels, minlength=1)[texels] > 1
    overlapping = np.zeros(len(uvs), np.bool_)
    overlapping[faces[shared]] = True
    judged = solid & ~missing
    density = np.sqrt(uv_area / np.maximum(area, 1e-12))
    uneven = np.zeros(len(uvs), np.bool_)
    if judged.any():
        ratio = density / _median(density[judged], area[judged])
        uneven = judged & ((ratio > DENSITY_RATIO) | (ratio < 1 / DENSITY_RATIO))
    return UvFaults(missing, outside, overlapping & ~missing, uneven)


def uv_verdict(uvs: NDArray[np.float32]) -> tuple[str, NDArray[np.float32]]:
    """Why UVs (F, 3, 2) of the paint cannot be used ('' if they can), and the UVs moved into [0, 1]."""
    if not np.isfinite(uvs).all():
        return ("they are missing" if np.isnan(uvs).all() else "some are NaN or missing"), np.nan_to_num(uvs)
    if np.ptp(uvs, axis=(0, 1)).max() < 1e-6:
        return "all are in one point", uvs
    moved, crossing = _in_tile(uvs)
    if crossing.any():
        return f"{crossing.mean():.1%} of the painted faces reach beyond the texture", moved
    overlap = shared_texels(moved)
    if overlap is None:
        return "they cover no texel", moved
    return f"{overlap:.0%} of the texels are used twice" if overlap > OVERLAP_LIMIT else "", moved


def shared_texels(uvs: NDArray[np.floating]) -> float | None:
    """Share of the texels that UVs (F, 3, 2) in [0, 1] cover that two faces cover; None where they cover none."""
    hits = np.bincount(geometry.covered(uvs, CHECK_ATLAS, conservative=False)[0], minlength=1)
    return float((hits > 1).sum() / (hits > 0).sum()) if hits.any() else None


def _in_tile(uvs: NDArray) -> tuple[NDArray, NDArray[np.bool_]]:
    """UVs moved into [0, 1] by whole tiles, where a repeated texture looks the same; True where that cannot be."""
    moved = uvs - np.floor(uvs.min(axis=1, keepdims=True) + 1e-4)
    crossing = moved.max(axis=(1, 2)) > 1 + BEYOND
    return np.clip(moved, 0.0, 1.0), crossing


def _median(values: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    order = np.argsort(values)
    rising = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(rising, rising[-1] / 2)])
