"""A clean UV atlas for a vehicle's paint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..contract import RaucaError, Vehicle
from .atlas import chart_of_faces, density_spread, signed_uv_area
from .mesh import face_normals
from .pack import pack_charts
from .raster import covered

ATLAS_SIZE = 1024
PADDING_TEXELS = 4
MAX_COSTS = (16.0, 4.0, 2.0, 1.0, 0.5, 0.25)  # of xatlas: large charts first, smaller ones where they stretch too much
SPREAD_LIMIT = 0.05  # of the texel density within a chart, see `atlas.density_spread`
MASK_DILATION = 1  # texels; bilinear reads on a chart's border then meet paint only


def unwrap(
    vehicle: Vehicle,
    size: int = ATLAS_SIZE,
    padding: int = PADDING_TEXELS,
    groups: NDArray[np.int64] | None = None,
) -> Vehicle:
    """Give the paint faces a UV atlas of their own, and the paint mask that goes with it.

    Charts do not overlap, share one texel density and lie at least ``padding`` empty texels apart (the mask spreads
    ``MASK_DILATION`` texels into that gap). Faces that are not paint get UV 0.

    Args:
        size: of the square atlas, texels.
        groups: (F,) faces of different groups never share a chart, e.g. body panels; None leaves the cuts to xatlas.

    Returns:
        A copy of the vehicle with new ``uvs``, ``paint_mask`` and ``padding_texels``, without base texture.

    Raises:
        RaucaError: no paint, or a mesh that xatlas cannot unwrap.
    """
    paint = vehicle.paint_faces()
    if not paint.any():
        raise RaucaError(f"vehicle {vehicle.name}: no face has a paint material, nothing to unwrap")
    uvs = np.zeros_like(vehicle.uvs)
    faces = vehicle.triangles[paint]
    parts = np.zeros(len(faces), np.int64) if groups is None else groups[paint]
    for max_cost in MAX_COSTS:
        flat, chart = _charts(vehicle.positions, faces, parts, max_cost)
        if density_spread(flat, vehicle.positions, faces, chart).max() <= SPREAD_LIMIT:
            break
    uvs[paint] = pack_charts(flat, chart, size, padding)
    return replace(vehicle, uvs=uvs, paint_mask=chart_mask(uvs[paint], size), padding_texels=padding, base_texture=None)


def chart_mask(uvs: NDArray[np.float32], size: int) -> NDArray[np.uint8]:
    """(size, size) mask: 255 on every texel that a face (F, 3, 2) touches and on those next to it, else 0."""
    texels, _ = covered(uvs, size, conservative=True)
    mask = np.zeros((size, size), np.bool_)
    mask.ravel()[texels] = True
    for _ in range(MASK_DILATION):
        wide = mask.copy()
        for axis in (0, 1):
            padded = np.pad(wide, [(1, 1) if a == axis else (0, 0) for a in (0, 1)])
            n = padded.shape[axis]
            wide = padded.take(range(n - 2), axis) | padded.take(range(1, n - 1), axis) | padded.take(range(2, n), axis)
        mask = wide
    return np.where(mask, 255, 0).astype(np.uint8)


def _charts(
    positions: NDArray[np.float32], faces: NDArray[np.int32], groups: NDArray[np.int64], max_cost: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Charts of faces, in metres: UVs (F, 3, 2), each chart scaled to its true area, and the chart of each face."""
    import xatlas

    options = xatlas.ChartOptions()
    options.max_cost = max_cost
    uvs = np.zeros((len(faces), 3, 2))
    charts = np.zeros(len(faces), np.int64)
    total = 0
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
        chart = chart_of_faces(faces[members], (uvs[members] / 4096).astype(np.float32))
        charts[members] = chart + total
        total += int(chart.max()) + 1
    _, area = face_normals(positions, faces)
    ratio = np.bincount(charts, area) / np.maximum(np.bincount(charts, np.abs(signed_uv_area(uvs))), 1e-30)
    return uvs * np.sqrt(ratio)[charts][:, None, None], charts
