"""The vehicles that rauca brings, as objects of the open scene."""

from __future__ import annotations

import bpy
import numpy as np

from ..core import assets, contract
from .images import read_image_blender
from .paint import UV_LAYER
from .rendered import rendered
from .vehicle import SceneVehicle
from .vehicle_request import VehicleRequest

NAME_KEY = "rauca_vehicle"  # custom property of the object: the shipped vehicle it was made from


def shipped_names() -> list[str]:
    """Names of the shipped vehicles."""
    return sorted(p.parent.name for p in (assets.assets_folder() / "vehicles").glob("*/vehicle.json"))


def load_shipped(name: str) -> contract.Vehicle:
    """A shipped vehicle by name."""
    return contract.load_vehicle(assets.assets_folder() / "vehicles" / name, read_image_blender)


def add_shipped(scene: bpy.types.Scene, name: str) -> bpy.types.Object:
    """Add a shipped vehicle to ``scene``, its images packed; the object knows what it is."""
    placed = SceneVehicle(scene, load_shipped(name))
    placed.paint.pack()
    placed.object.name = placed.object.data.name = name
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
    shape = (len(vehicle.positions), len(vehicle.triangles), 3 * len(vehicle.triangles))
    scaled = not np.allclose(thing.matrix_world.to_scale(), 1.0, atol=1e-4)
    if scaled or thing.modifiers or layer is None or (len(mesh.vertices), len(mesh.polygons), len(mesh.loops)) != shape:
        return None
    wanted = (vehicle.positions, vehicle.triangles, vehicle.uvs, vehicle.material)
    for (collection, key), array in zip(
        ((mesh.vertices, "co"), (mesh.loops, "vertex_index"), (layer.uv, "vector"), (mesh.polygons, "material_index")),
        wanted,
        strict=True,
    ):
        found = np.empty(array.size, np.float32 if array.dtype.kind == "f" else np.int32)
        collection.foreach_get(key, found)
        if not np.array_equal(found, array.ravel()):
            return None
    return vehicle
