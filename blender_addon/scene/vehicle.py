"""The vehicle in the scene: one mesh object from the contract's arrays, so that both worlds share every vertex.

The vehicles that rauca brings can be added to the open scene, and are known again there.
"""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ..core import assets, contract
from . import nodes
from .blocks import rendered, values_of
from .images import read_image_blender
from .paint import UV_LAYER, Paint, finish_inputs
from .vehicle_request import VehicleRequest
from .wetness import wet

SEMANTIC_CLASSES = {"paint": "paint", "glass": "glass", "tyre": "tyre"}  # by kind; every other kind is vehicle_part
CLASS_KEY = "rauca_class"  # custom property of a material: its class in label maps
LAMP_RADIANCE = {"headlamp": 12.0, "taillamp": 2.5}  # lit at night, relative to a sunlit white surface


class SceneVehicle:
    """The vehicle's mesh object, its paint, and one Blender material per contract material, in order."""

    def __init__(self, scene: bpy.types.Scene, vehicle: contract.Vehicle, finish: str = "own") -> None:
        """Add the vehicle to ``scene``, its paint in a finish: ``own``, ``car_paint`` or ``sticker``."""
        self.vehicle = vehicle
        mesh = _mesh(vehicle)
        self.object = bpy.data.objects.new("rauca vehicle", mesh)
        scene.collection.objects.link(self.object)
        self.paint = Paint(vehicle)
        self.materials = [_material(spec, self.paint, finish) for spec in vehicle.materials]
        for spec, material in zip(vehicle.materials, self.materials, strict=True):
            material[CLASS_KEY] = SEMANTIC_CLASSES.get(spec.kind, "vehicle_part")
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


def _material(spec: contract.Material, paint: Paint, finish: str) -> bpy.types.Material:
    """The material of a part: under the paint in a finish, or plain."""
    material = bpy.data.materials.new(f"rauca {spec.name}")
    tree = nodes.fresh_tree(material)
    color = paint.below(tree, spec)
    if spec.kind == "paint":
        inputs = finish_inputs(spec, finish)
        color = paint.connect(tree, color)
        metallic = 0.0  # a metallic base tints its highlights: radiance would no longer be affine in the color
    else:
        glow = {"Emission_Color": (*spec.base_color, 1.0), "Emission_Strength": spec.emission}
        inputs = {"Roughness": spec.roughness, "Coat_Weight": spec.coat, **glow}
        metallic = spec.metallic
    base, roughness = wet(tree, color, inputs["Roughness"], porosity=0.0)
    nodes.principled_surface(tree, **{**inputs, "Base_Color": base, "Roughness": roughness, "Metallic": metallic})
    return material


NAME_KEY = "rauca_vehicle"  # custom property of the object: the shipped vehicle it was made from


def shipped_names() -> list[str]:
    """Names of the shipped vehicles."""
    return list(assets.shipped_vehicles())


def load_shipped(name: str) -> contract.Vehicle:
    """A shipped vehicle by name."""
    return contract.load_vehicle(assets.assets_folder() / "vehicles" / name, read_image_blender)


def add_vehicle(
    scene: bpy.types.Scene, vehicle: contract.Vehicle, collection: bpy.types.Collection
) -> bpy.types.Object:
    """Add a vehicle to ``scene`` at the 3D cursor, its images packed; the object of a shipped one knows what it is.

    Args:
        collection: of the scene, to put it in: the active one, as Blender's own Add menu does.
    """
    placed, name = SceneVehicle(scene, vehicle), vehicle.name
    if collection != scene.collection and collection.library is None:
        collection.objects.link(placed.object)
        scene.collection.objects.unlink(placed.object)
    placed.paint.pack()
    placed.object.name = placed.object.data.name = name
    placed.object.location = scene.cursor.location
    if name in shipped_names() and load_shipped(name).geometry_id == vehicle.geometry_id:
        placed.object[NAME_KEY] = name
    for spec, material in zip(placed.vehicle.materials, placed.materials, strict=True):
        material.diffuse_color = (*spec.base_color, 1.0)  # what the viewport's solid view shows
    return placed.object


def untouched_shipped(objects: list[bpy.types.Object], request: VehicleRequest) -> contract.Vehicle | None:
    """The shipped vehicle that ``objects`` are; None for another mesh, an edited one, or one with other paint."""
    meshes = [thing for thing in rendered(objects) if thing.type == "MESH"]
    if request.own_paint or len(meshes) != 1 or meshes[0].get(NAME_KEY) not in shipped_names():
        return None
    thing = meshes[0]
    vehicle, mesh = load_shipped(thing[NAME_KEY]), thing.data
    layer = mesh.uv_layers.get(UV_LAYER)
    scaled = not np.allclose(thing.matrix_world.to_scale(), 1.0, atol=1e-4)
    if scaled or thing.modifiers or layer is None:
        return None
    same = (
        np.array_equal(values_of(mesh.vertices, "co", np.float32, 3), vehicle.positions)
        and np.array_equal(values_of(mesh.loops, "vertex_index", np.int32), vehicle.triangles.ravel())
        and np.array_equal(values_of(layer.uv, "vector", np.float32, 2), vehicle.uvs.reshape(-1, 2))
        and np.array_equal(values_of(mesh.polygons, "material_index", np.int32), vehicle.material)
    )
    return vehicle if same else None
