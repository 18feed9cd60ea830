"""A clean UV atlas for a vehicle's paint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..contract import RaucaError, Vehicle
from .raster import covered

ATLAS_SIZE = 1024
PADDING_TEXELS = 4
MASK_DILATION = 1  # texels; bilinear reads on a chart's border then meet paint only


def unwrap(vehicle: Vehicle, size: int = ATLAS_SIZE, padding: int = PADDING_TEXELS) -> Vehicle:
    """Give the paint faces a UV atlas of their own, and the paint mask that goes with it.

    Charts do not overlap, share one texel density and lie at least ``padding`` empty texels apart (the mask spreads
    ``MASK_DILATION`` texels into that gap). Faces that are not paint get UV 0.

    Args:
        size: of the square atlas, texels.

    Returns:
        A copy of the vehicle with new ``uvs``, ``paint_mask`` and ``padding_texels``, without base texture.

    Raises:
        RaucaError: no paint, or a mesh that xatlas cannot unwrap.
    """
    paint = vehicle.paint_faces()
    if not paint.any():
        raise RaucaError(f"vehicle {vehicle.name}: no face has a paint material, nothing to unwrap")
    uvs = np.zeros_like(vehicle.uvs)
    uvs[paint] = _atlas(vehicle.positions, vehicle.triangles[paint], size, padding)
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


def _atlas(positions: NDArray[np.float32], faces: NDArray[np.int32], size: int, padding: int) -> NDArray[np.float32]:
    """UVs (F, 3, 2) of faces, packed as densely as fits one page of ``size`` texels."""
    import xatlas

    used, compact = np.unique(faces, return_inverse=True)
    mesh = (positions[used].astype(np.float32), compact.reshape(-1, 3).astype(np.uint32))
    charts = xatlas.ChartOptions()
    charts.max_cost, charts.normal_deviation_weight = 2.0, 2.0
    charts.max_iterations = 4
    pack = xatlas.PackOptions()
    pack.padding, pack.resolution, pack.bilinear, pack.bruteForce = padding, size, True, False
    area = (
        np.linalg.norm(np.cross(*(mesh[0][mesh[1][:, i]] - mesh[0][mesh[1][:, 0]] for i in (1, 2))), axis=1).sum() / 2
    )
    low, high, best = 0.0, size / np.sqrt(area), None
    for _ in range(6):
        pack.texels_per_unit = (low + high) / 2
        atlas = xatlas.Atlas()
        atlas.add_mesh(*mesh)
        atlas.generate(charts, pack)
        if atlas.atlas_count == 1 and max(atlas.width, atlas.height) <= size:
            low, best = pack.texels_per_unit, atlas
        else:
            high = pack.texels_per_unit
    if best is None:
        raise RaucaError("the paint does not fit a UV atlas; simplify the mesh")
    _, indices, uv = best[0]
    scaled = uv * (np.array([best.width, best.height]) / size)
    return scaled[indices].astype(np.float32)
