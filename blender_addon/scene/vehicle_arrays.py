"""The triangles of Blender objects as arrays."""

from __future__ import annotations

from dataclasses import dataclass, field

import bpy
import numpy as np
from numpy.typing import NDArray


@dataclass
class Soup:
    """Triangles of all objects in world space, metres.

    Attributes:
        positions: (V, 3) float64.
        triangles: (F, 3) int32.
        uvs: (F, 3, 2) float32, NaN where an object has no UVs.
        normals: (F, 3, 3) float32 unit shading normals.
        material: (F,) index into ``names``.
        names: material names; the empty name stands for faces without one.
    """

    positions: NDArray[np.float64]
    triangles: NDArray[np.int32]
    uvs: NDArray[np.float32]
    normals: NDArray[np.float32]
    material: NDArray[np.int16]
    names: list[str] = field(default_factory=list)


def read_objects(objects: list[bpy.types.Object]) -> Soup:
    """Join the evaluated meshes of objects, and of what they instance; objects hidden from renders are left out."""
    wanted = {o.name_full for o in objects if not o.hide_render}
    names: list[str] = []
    pieces: list[Soup] = []
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        owner = instance.parent if instance.is_instance else instance.object
        if owner is None or owner.original.name_full not in wanted:
            continue
        if not (instance.show_self or instance.is_instance):
            continue
        item = instance.object
        if item.type not in {"MESH", "CURVE", "SURFACE", "META", "FONT"}:
            continue
        mesh = item.to_mesh()
        if mesh is not None and len(mesh.polygons):
            slots = [slot.material.name if slot.material else "" for slot in item.material_slots] or [""]
            names += [name for name in slots if name not in names]
            pieces.append(_triangles(mesh, np.array(instance.matrix_world), [names.index(name) for name in slots]))
        item.to_mesh_clear()
    return _joined(pieces, names)


def _triangles(mesh: bpy.types.Mesh, to_world: NDArray[np.float64], slots: list[int]) -> Soup:
    mesh.calc_loop_triangles()
    count, loops = len(mesh.loop_triangles), len(mesh.loops)
    positions = _get(mesh.vertices, "co", (len(mesh.vertices), 3), np.float32).astype(np.float64)
    corners = _get(mesh.loop_triangles, "loops", (count, 3), np.int32)
    vertex = _get(mesh.loops, "vertex_index", (loops,), np.int32)
    normals = _get(mesh.corner_normals, "vector", (loops, 3), np.float32)[corners]
    slot = _get(mesh.loop_triangles, "material_index", (count,), np.int32)
    layer = next((u for u in mesh.uv_layers if u.active_render), mesh.uv_layers.active)
    uvs = np.full((loops, 2), np.nan, np.float32)
    if layer is not None:
        uvs = _get(layer.uv, "vector", (loops, 2), np.float32)
    linear = to_world[:3, :3]
    positions = positions @ linear.T + to_world[:3, 3]
    if np.linalg.det(linear) < 0:  # a mirrored object turns its faces inside out
        corners, normals = corners[:, ::-1], normals[:, ::-1]
    normals = normals.astype(np.float64) @ np.linalg.pinv(linear)
    triangles = vertex[corners]
    material = np.array(slots, np.int16)[np.minimum(slot, len(slots) - 1)]
    return Soup(positions, triangles, uvs[corners], _unit(normals, positions, triangles), material)


def _unit(
    normals: NDArray[np.float64], positions: NDArray[np.float64], faces: NDArray[np.int32]
) -> NDArray[np.float32]:
    """Normals of length 1; a corner without one takes its face's, a face without area looks up."""
    edges = positions[faces[:, 1:]] - positions[faces[:, :1]]
    flat = np.cross(edges[:, 0], edges[:, 1])[:, None, :] * np.ones((1, 3, 1))
    flat = np.where(np.linalg.norm(flat, axis=2, keepdims=True) > 1e-30, flat, [0.0, 0.0, 1.0])
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    chosen = np.where(np.isfinite(length) & (length > 1e-6), normals, flat)
    return (chosen / np.linalg.norm(chosen, axis=2, keepdims=True)).astype(np.float32)


def _joined(pieces: list[Soup], names: list[str]) -> Soup:
    if not pieces:
        empty = np.zeros((0, 3, 3), np.float32)
        return Soup(np.zeros((0, 3)), np.zeros((0, 3), np.int32), empty[..., :2], empty, np.zeros(0, np.int16), names)
    first = np.cumsum([0] + [len(p.positions) for p in pieces[:-1]])
    return Soup(
        np.concatenate([p.positions for p in pieces]),
        np.concatenate([p.triangles + start for p, start in zip(pieces, first, strict=True)]).astype(np.int32),
        np.concatenate([p.uvs for p in pieces]),
        np.concatenate([p.normals for p in pieces]),
        np.concatenate([p.material for p in pieces]),
        names,
    )


def _get(collection: bpy.types.bpy_prop_collection, name: str, shape: tuple[int, ...], kind: type) -> NDArray:
    values: NDArray = np.empty(shape, kind)
    collection.foreach_get(name, values.ravel())
    return values
