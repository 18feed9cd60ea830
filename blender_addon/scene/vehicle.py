"""The vehicle in the scene: one mesh object from the contract's arrays, so that both worlds share every vertex."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ..core import contract
from . import nodes
from .paint import UV_LAYER, Paint, paint_material
from .wetness import wet

SEMANTIC_CLASSES = {"paint": "paint", "glass": "glass", "tyre": "tyre"}  # by kind; every other kind is vehicle_part
LAMP_RADIANCE = {"headlamp": 12.0, "taillamp": 2.5}  # lit at night, relative to a sunlit white surface


class SceneVehicle:
    """The vehicle's object and what a pipeline does to it.

    Attributes:
        vehicle: the contract's vehicle.
        object: Blender's mesh object.
        paint: the paint shared by all its paint materials.
        materials: one Blender material per contract material, in order.
    """

    def __init__(self, scene: bpy.types.Scene, vehicle: contract.Vehicle, finish: str = "own") -> None:
        """Add the vehicle to ``scene``, its paint in a finish: ``own``, ``car_paint`` or ``sticker``."""
        self.vehicle = vehicle
        mesh = _mesh(vehicle)
        self.object = bpy.data.objects.new("rauca vehicle", mesh)
        scene.collection.objects.link(self.object)
        self.paint = Paint(vehicle)
        self.materials = [
            paint_material(m, self.paint, finish) if m.kind == "paint" else _plain_material(m, self.paint)
            for m in vehicle.materials
        ]
        for spec, material in zip(vehicle.materials, self.materials, strict=True):
            material["rauca_class"] = SEMANTIC_CLASSES.get(spec.kind, "vehicle_part")
            mesh.materials.append(material)
        mesh.polygons.foreach_set("material_index", vehicle.material.astype(np.int32))

    @property
    def center(self) -> NDArray[np.float64]:
        """The middle of the bounding box, vehicle frame, metres."""
        positions = self.vehicle.positions
        return ((positions.min(axis=0) + positions.max(axis=0)) / 2).astype(np.float64)

    def place(self, vehicle_to_world: NDArray[np.float64]) -> None:
        """Move the vehicle; (4, 4) rigid transform."""
        self.object.matrix_world = Matrix(vehicle_to_world.tolist())

    def light_lamps(self, level: float) -> None:
        """Turn up head and tail lamps, 0 (by day) to 1."""
        for spec, material in zip(self.vehicle.materials, self.materials, strict=True):
            if spec.kind in LAMP_RADIANCE:
                strength = spec.emission + level * (LAMP_RADIANCE[spec.kind] - spec.emission)
                nodes.principled(material.node_tree).inputs["Emission Strength"].default_value = strength


def _mesh(vehicle: contract.Vehicle) -> bpy.types.Mesh:
    mesh = bpy.data.meshes.new("rauca vehicle")
    faces = len(vehicle.triangles)
    mesh.vertices.add(len(vehicle.positions))
    mesh.vertices.foreach_set("co", vehicle.positions.ravel())
    mesh.loops.add(3 * faces)
    mesh.loops.foreach_set("vertex_index", vehicle.triangles.ravel())
    mesh.polygons.add(faces)
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * faces, 3, dtype=np.int32))
    mesh.uv_layers.new(name=UV_LAYER).uv.foreach_set("vector", vehicle.uvs.ravel())
    mesh.update(calc_edges=True)
    # No mesh.validate(): it would drop duplicate faces and so break the face order that both worlds share.
    mesh.normals_split_custom_set(vehicle.normals.reshape(-1, 3).tolist())
    return mesh


def _plain_material(spec: contract.Material, paint: Paint) -> bpy.types.Material:
    material = bpy.data.materials.new(f"rauca {spec.name}")
    tree = nodes.fresh_tree(material)
    color = paint.base_texture_socket(tree) if spec.textured else (*spec.base_color, 1.0)
    base, roughness = wet(tree, color, spec.roughness, porosity=0.0)
    shader = nodes.add(
        tree,
        "ShaderNodeBsdfPrincipled",
        Base_Color=base,
        Roughness=roughness,
        Metallic=spec.metallic,
        Coat_Weight=spec.coat,
        Emission_Color=(*spec.base_color, 1.0),
        Emission_Strength=spec.emission,
    )
    nodes.output(tree, Surface=shader.outputs[0])
    return material
