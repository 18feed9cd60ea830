"""Readers inside Blender: vehicles as .obj, .glb, .gltf and .blend, and images. Needs bpy."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import numpy as np

from blender_addon.jobs.thumbnails import thumbnail
from blender_addon.scene.images import read_image_blender
from blender_addon.scene.vehicle_files import import_vehicle
from rauca_core.contract.files import png_bytes
from tests.blender.test_vehicle_import import obj_text, write_glb

from .contract_targets import TARGETS as CONTRACT
from .mutate import mutate_bytes, mutate_json, mutate_text
from .target import Target

MTL = "newmtl car_paint\nKd 0.5 0.5 0.5\nmap_Kd skin.png\nnewmtl window glass\nKd 0 0 0\n"


def _obj(folder: Path) -> None:
    (folder / "box.obj").write_text("mtllib box.mtl\n" + obj_text())
    (folder / "box.mtl").write_text(MTL)
    (folder / "skin.png").write_bytes(png_bytes(np.full((8, 8, 3), 90, np.uint8)))


def _glb(folder: Path) -> None:
    write_glb(folder / "box.glb")


def _gltf(folder: Path) -> None:
    """The .glb in two files, its geometry beside it."""
    write_glb(folder / "box.glb")
    data = (folder / "box.glb").read_bytes()
    length = int.from_bytes(data[12:16], "little")
    document = json.loads(data[20 : 20 + length])
    document["buffers"][0]["uri"] = "box.bin"
    document["images"] = [{"uri": "skin.png"}]
    (folder / "box.bin").write_bytes(data[28 + length :])
    (folder / "skin.png").write_bytes(png_bytes(np.full((8, 8, 3), 90, np.uint8)))
    (folder / "box.gltf").write_text(json.dumps(document))


def _blend(folder: Path) -> None:
    _obj(folder)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.obj_import(filepath=str(folder / "box.obj"))
    bpy.data.libraries.write(str(folder / "box.blend"), set(bpy.data.objects), compress=False)
    bpy.ops.wm.read_factory_settings(use_empty=True)


TARGETS = (
    Target("obj", "box.obj", _obj, lambda f: import_vehicle(f / "box.obj"), mutate_text),
    Target("mtl", "box.mtl", _obj, lambda f: import_vehicle(f / "box.obj"), mutate_text),
    Target("glb", "box.glb", _glb, lambda f: import_vehicle(f / "box.glb", None, "body paint"), mutate_bytes),
    Target("gltf", "box.gltf", _gltf, lambda f: import_vehicle(f / "box.gltf", None, "body paint"), mutate_json),
    Target("blend", "box.blend", _blend, lambda f: import_vehicle(f / "box.blend"), mutate_bytes),
    *(
        Target(f"blender-{one.name}", one.file, one.build, lambda f, name=one.file: read_image_blender(f / name))
        for one in CONTRACT
        if one.name in ("png", "jpeg")
    ),
    *(
        Target("thumbnail", one.file, one.build, lambda f, name=one.file: thumbnail(f / name))
        for one in CONTRACT
        if one.name == "png"
    ),
)
