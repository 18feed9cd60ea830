"""A box that an artist made, and a camouflage for it: what the tests of steps 6 and 7 paint."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from rauca_core.contract import Camouflage, save_camouflage
from rauca_core.contract.files import png_bytes


def a_box(name="Box", material="body paint", size=(4.0, 2.0, 1.5), **changes) -> bpy.types.Object:
    """A box with Blender's own UVs, its roof of glass, its paint a red metal; picked in step 1."""
    bpy.ops.mesh.primitive_cube_add(size=1.0, calc_uvs=True, **changes)
    box = bpy.context.object
    box.name = box.data.name = name
    box.scale = size
    for known in (material, "glass"):
        made = bpy.data.materials.get(known) or bpy.data.materials.new(known)
        if made.node_tree is None:  # from 5.0 they are born with one
            made.use_nodes = True
        box.data.materials.append(made)
    shader = box.data.materials[0].node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value, shader.inputs["Metallic"].default_value = (0.8, 0.1, 0.1, 1), 1.0
    max(box.data.polygons, key=lambda polygon: polygon.center.z).material_index = 1
    settings = bpy.context.scene.rauca.vehicle
    settings.origin, settings.object = "OBJECT", box
    bpy.context.view_layer.update()
    return box


def noise(size: int = 64) -> np.ndarray:
    """A camouflage's texels (size, size, 3), every one another color."""
    return np.random.default_rng(5).integers(0, 256, (size, size, 3)).astype(np.uint8)


def a_camouflage(folder: Path, texels: np.ndarray | None = None, atlas_id: str = "", vehicle: str = "Box") -> Path:
    """Save a camouflage for the vehicle of step 1, and choose it in step 6."""
    texels = noise() if texels is None else texels
    fits = atlas_id or bpy.context.scene.rauca.vehicle.chosen(bpy.context).atlas_id
    path = folder / "made" / "spots.json"
    save_camouflage(path, Camouflage("spots", vehicle, fits, len(texels), "random"), png_bytes(texels))
    bpy.context.scene.rauca.camouflage.file = str(path)
    return path


def painted_box(folder: Path) -> bpy.types.Object:
    """A box in its camouflage."""
    box = a_box()
    a_camouflage(folder)
    assert bpy.ops.rauca.apply_camouflage() == {"FINISHED"}
    return box


def a_layer(box: bpy.types.Object, name: str, scale: float = 1.0, shift: float = 0.0) -> None:
    """Another UV layer: each face a quarter turn on, in a place of its own in a grid of three by three."""
    first = box.data.uv_layers[0].name
    layer = box.data.uv_layers.new(name=name)
    box.data.uv_layers.active = box.data.uv_layers[first]
    corners = np.array([(0, 0), (0, 1), (1, 1), (1, 0)]) * 0.28 * scale
    for polygon in box.data.polygons:
        for k, loop in enumerate(polygon.loop_indices):
            place = np.array([polygon.index % 3, polygon.index // 3]) / 3 * min(scale, 1.0) + 0.02 + shift
            layer.uv[loop].vector = corners[k] + place
