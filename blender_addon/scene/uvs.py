"""UVs of the paint: what is wrong with them, as a whole for the import and by faces for the artist, and new ones."""

from __future__ import annotations

import math

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import contract, geometry
from .blocks import nothing_selected, values_of
from .render import silenced

OVERLAP_LIMIT = 0.02  # of the covered texels; more than stray slivers, and one texel would paint two places
CHECK_ATLAS = 1024
BEYOND = 1e-3  # of the texture's side; less is rounding
SMART_ANGLE_DEG = 40.0
DENSITY_RATIO = 2.0  # times finer or coarser than the paint's median: the pattern visibly changes its size


def uv_faults(uvs: NDArray[np.float32], area: NDArray[np.float64]) -> dict[str, NDArray[np.bool_]]:
    """Judge the UVs (F_paint, 3, 2) of faces with ``area`` (F_paint,) on the surface, square metres.

    Returns:
        The faulty faces, (F_paint,) each: ``missing`` UVs, or an area in the texture; ``outside`` the texture, or in
        another tile of it; ``overlapping`` another face, by a texel; ``uneven``: texels more than ``DENSITY_RATIO``
        times finer or coarser than the paint's median by area.
    """
    finite = np.isfinite(uvs).all(axis=(1, 2))
    clean = np.where(finite[:, None, None], uvs, 0.0).astype(np.float64)
    uv_area = np.abs(geometry.signed_uv_area(clean))
    solid = area > 1e-12
    missing = ~finite | (solid & (uv_area < 1e-12))
    outside = finite & ((clean < -BEYOND) | (clean > 1 + BEYOND)).any(axis=(1, 2))
    moved, _, _ = in_tile(clean)
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
    return {"missing": missing, "outside": outside, "overlapping": overlapping & ~missing, "uneven": uneven}


def uv_verdict(uvs: NDArray[np.float32]) -> tuple[str, NDArray[np.float32]]:
    """Why UVs (F, 3, 2) of the paint cannot be used ('' if they can), and the UVs moved into [0, 1]."""
    if not np.isfinite(uvs).all():
        return ("they are missing" if np.isnan(uvs).all() else "some are NaN or missing"), np.nan_to_num(uvs)
    if np.ptp(uvs, axis=(0, 1)).max() < 1e-6:
        return "all are in one point", uvs
    moved, crossing, _ = in_tile(uvs)
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


def in_tile(uvs: NDArray, slack: float = 1e-4) -> tuple[NDArray, NDArray[np.bool_], NDArray]:
    """UVs (F, 3, 2) moved into [0, 1] by whole tiles, where a repeated texture looks the same.

    Returns:
        The moved UVs, True (F,) where a face reaches beyond its tile, and the tiles (F, 1, 2).
    """
    tile = np.floor(uvs.min(axis=1, keepdims=True) + slack)
    moved = uvs - tile
    crossing = moved.max(axis=(1, 2)) > 1 + BEYOND
    return np.clip(moved, 0.0, 1.0), crossing, tile


def _median(values: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    order = np.argsort(values)
    rising = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(rising, rising[-1] / 2)])


def unwrapped(vehicle: contract.Vehicle) -> tuple[contract.Vehicle, str]:
    """The vehicle with a fresh atlas by xatlas, and ''; without xatlas by Blender, and the words that say so."""
    try:
        return geometry.unwrap(vehicle), ""
    except ImportError:
        fresh = geometry.repack(vehicle, smart_project(vehicle))
        return fresh, " with Blender's own unwrapping: more and smaller ones than elsewhere"


def smart_project(vehicle: contract.Vehicle) -> NDArray[np.float64]:
    """Flat charts of the paint faces by Smart UV Project: (F_paint, 3, 2), not packed."""
    faces = vehicle.triangles[vehicle.paint_faces()]
    used, compact = np.unique(faces, return_inverse=True)
    mesh = bpy.data.meshes.new("rauca unwrap")
    item = bpy.data.objects.new("rauca unwrap", mesh)
    layer = bpy.context.view_layer
    with nothing_selected():  # edit mode takes in whatever is selected, and would lay it out anew as well
        try:
            mesh.from_pydata(vehicle.positions[used].tolist(), [], compact.reshape(-1, 3).tolist())
            mesh.uv_layers.new(name="flat")
            bpy.context.scene.collection.objects.link(item)
            layer.update()
            layer.objects.active = item
            item.select_set(True)
            with silenced():
                bpy.ops.object.mode_set(mode="EDIT")
                bpy.ops.mesh.select_all(action="SELECT")
                bpy.ops.uv.smart_project(angle_limit=math.radians(SMART_ANGLE_DEG), island_margin=0.002)
                bpy.ops.object.mode_set(mode="OBJECT")
            uvs = values_of(mesh.uv_layers[0].uv, "vector", np.float32, 2).reshape(-1, 3, 2)
        finally:
            bpy.data.batch_remove([item, mesh])
    return uvs.astype(np.float64)
