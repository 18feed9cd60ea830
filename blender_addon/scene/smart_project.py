"""Blender's own unwrapping, for a Blender whose Python has no xatlas."""

from __future__ import annotations

import math

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import contract
from .render import silenced

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
        uvs = np.empty(6 * len(faces), np.float32)
        mesh.uv_layers[0].uv.foreach_get("vector", uvs)
    finally:
        bpy.data.objects.remove(item)
        bpy.data.meshes.remove(mesh)
        for other in selected:
            other.select_set(True)
        layer.objects.active = active
    return uvs.reshape(-1, 3, 2).astype(np.float64)
