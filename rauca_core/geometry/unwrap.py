"""A clean UV atlas for a vehicle's paint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..contract import RaucaError, Vehicle
from .atlas import chart_of_faces, density_spread, dilated, signed_uv_area, touched
from .mesh import Floats, Indices, Integers, Points, face_normals
from .pack import pack_charts

ATLAS_SIZE = 1024
PADDING_TEXELS = 4
MASK_DILATION = 1  # texels; bilinear reads on a chart's border then meet paint only
SPREAD_LIMIT = 0.05  # of the texel density within a chart, see `atlas.density_spread`
MAX_COSTS = (16.0, 4.0, 2.0, 1.0, 0.5, 0.25)  # xatlas's: large charts first, smaller ones where they stretch too much


def unwrap(vehicle: Vehicle, size: int = ATLAS_SIZE, groups: Integers | None = None) -> Vehicle:
    """Give the paint faces a UV atlas of their own, and the paint mask that goes with it.

    Charts do not overlap, share one texel density (within a chart it spreads by at most ``SPREAD_LIMIT`` wherever
    xatlas can cut that small) and lie at least ``PADDING_TEXELS`` empty texels apart and from the border; the mask
    spreads ``MASK_DILATION`` texels into that gap. Faces that are not paint get UV 0.

    Args:
        size: of the square atlas, texels.
        groups: (F,) faces of different groups never share a chart, e.g. body panels; None leaves the cuts to xatlas.

    Returns:
        A copy of the vehicle with new ``uvs``, ``paint_mask`` and ``padding_texels``, without base texture.

    Raises:
        RaucaError: no paint, a mesh that xatlas cannot unwrap, or charts that do not fit.
        ImportError: xatlas is not installed.
    """
    paint = vehicle.paint_faces()
    if not paint.any():
        raise RaucaError(f"vehicle {vehicle.name}: no face has a paint material, nothing to unwrap")
    faces = vehicle.triangles[paint]
    parts = np.zeros(len(faces), np.int64) if groups is None else np.asarray(groups)[paint]
    for max_cost in MAX_COSTS:
        flat = _flatten(vehicle.positions, faces, parts, max_cost)
        spread = density_spread(flat, vehicle.positions, faces, _charts(faces, flat))
        if spread.max() <= SPREAD_LIMIT:
            break
    return repack(vehicle, flat, size)


def repack(vehicle: Vehicle, flat: Points, size: int = ATLAS_SIZE) -> Vehicle:
    """Pack flattened paint faces (F_paint, 3, 2) into an atlas, each chart scaled to its area on the surface.

    Returns and raises as :func:`unwrap`.
    """
    paint = vehicle.paint_faces()
    faces = vehicle.triangles[paint]
    chart = _charts(faces, flat)
    _, area = face_normals(vehicle.positions, faces)
    ratio = np.bincount(chart, area) / np.maximum(np.bincount(chart, np.abs(signed_uv_area(flat))), 1e-30)
    uvs = np.zeros_like(vehicle.uvs)
    uvs[paint] = pack_charts(flat * np.sqrt(ratio)[chart][:, None, None], chart, size, PADDING_TEXELS)
    mask = chart_mask(uvs[paint], size)
    return replace(vehicle, uvs=uvs, paint_mask=mask, padding_texels=PADDING_TEXELS, base_texture=None)


def chart_mask(uvs: Floats, size: int) -> NDArray[np.uint8]:
    """(size, size) mask: 255 on every texel that a face (F, 3, 2) touches and on those next to it, else 0."""
    inner = slice(MASK_DILATION, -MASK_DILATION)
    wide = dilated(np.pad(touched(uvs, size), MASK_DILATION), MASK_DILATION)[inner, inner]
    return np.where(wide, 255, 0).astype(np.uint8)


def _charts(faces: Integers, flat: Points) -> Indices:
    """Chart of each face; UVs of any scale."""
    return chart_of_faces(faces, (flat / max(np.abs(flat).max(), 1e-30)).astype(np.float32))


def _flatten(positions: NDArray[np.float32], faces: NDArray[np.int32], groups: Integers, max_cost: float) -> Points:
    """Flat charts of faces by xatlas: UVs (F, 3, 2), apart from each other."""
    import xatlas

    options = xatlas.ChartOptions()
    options.max_cost = max_cost
    uvs = np.zeros((len(faces), 3, 2))
    right = 0.0
    for group in np.unique(groups):
        members = np.flatnonzero(groups == group)
        used, compact = np.unique(faces[members], return_inverse=True)
        atlas = xatlas.Atlas()
        atlas.add_mesh(positions[used].astype(np.float32), compact.reshape(-1, 3).astype(np.uint32))
        atlas.generate(options)
        if atlas.chart_count == 0:
            raise RaucaError("xatlas finds no charts on the paint; remove degenerate faces")
        _, indices, flat = atlas[0]
        uvs[members] = (flat * np.array([atlas.width, atlas.height], np.float64))[indices]
        uvs[members, :, 0] += right  # groups side by side, so that charts of two groups never touch
        right = uvs[members, :, 0].max() + 1.0
    return uvs
