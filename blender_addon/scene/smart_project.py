"""Blender's own unwrapping: for a Blender whose Python has no xatlas, and for a UV layer to bake into."""

from __future__ import annotations

import math

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import contract
from .mesh_edits import Surface, require_own_faces
from .render import silenced
from .vehicle_arrays import values_of

ANGLE_LIMIT_DEG = 40.0


def smart_project(vehicle: contract.Vehicle) -> NDArray[np.float64]:
    """Flat charts of the paint faces by Smart UV Project: (F_paint, 3, 2), not packed."""
    faces = vehicle.triangles[vehicle.paint_faces()]
    used, compact = np.unique(faces, return_inverse=True)
    mesh = bpy.data.meshes.new("rauca unwrap")
    item = bpy.data.objects.new("rauca unwrap", mesh)
    layer = bpy.context.view_layer
    active, selected = layer.objects.active, list(layer.objects.selected)
    for other in selected:  # edit mode takes in whatever is selected, and would lay it out anew as well
        other.select_set(False)
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
            bpy.ops.uv.smart_project(angle_limit=math.radians(ANGLE_LIMIT_DEG), island_margin=0.002)
            bpy.ops.object.mode_set(mode="OBJECT")
        uvs = values_of(mesh.uv_layers[0].uv, "vector", (len(faces), 3, 2), np.float32)
    finally:
        bpy.data.objects.remove(item)
        bpy.data.meshes.remove(mesh)
        for other in selected:
            other.select_set(True)
        layer.objects.active = active
    return uvs.astype(np.float64)


LAYER = "baked"


def add_layer(surface: Surface) -> str:
    """Lay the paint out by Blender's Smart UV Project in a new UV layer; returns its name. Active layers stay so.

    Raises:
        RaucaError: a mesh that cannot be written to, or has no room for another layer; nothing was changed.
    """
    pieces = surface.painted_pieces()
    require_own_faces(piece for piece, _ in pieces)
    full = [piece.owner.name for piece, _ in pieces if len(piece.owner.data.uv_layers) >= 8]
    if full:
        raise contract.RaucaError(f"{full[0]}: has 8 UV layers, Blender's most; remove one")
    taken = {layer.name for piece, _ in pieces for layer in piece.owner.data.uv_layers}
    name = next(n for n in (LAYER, *(f"{LAYER}.{i:03}" for i in range(1, 100))) if n not in taken)
    uvs = np.zeros_like(surface.vehicle.uvs)
    uvs[surface.paint] = smart_project(surface.vehicle)
    for piece, span in pieces:
        paint = surface.paint[span]
        _write(piece.owner.data, name, piece.loops[paint], uvs[span][paint])
    return name


def _write(mesh: bpy.types.Mesh, name: str, loops: NDArray[np.int32], uvs: NDArray[np.float32]) -> None:
    active = mesh.uv_layers.active
    shown = active.name if active is not None else ""
    layer = mesh.uv_layers.new(name=name, do_init=False)
    values = np.zeros((len(mesh.loops), 2), np.float32)
    values[loops.ravel()] = uvs.reshape(-1, 2)
    layer.uv.foreach_set("vector", values.ravel())
    if shown:
        mesh.uv_layers.active = mesh.uv_layers[shown]
    mesh.update()
