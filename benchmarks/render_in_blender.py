"""In a process of its own, with Blender: a vehicle's paint in Cycles as pure emission, seen by many cameras.

A job renders one of

- ``coverage``: the paint mask, with Cycles' default pixel filter;
- ``premultiplied``: mask times map, linear, with the same filter;
- ``uv``: u, v, 1 of the paint at the pixel's center, through the narrowest filter there is.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np

from blender_addon.scene import camera as cameras
from blender_addon.scene.images import blender_pixels, float_image, read_image_blender
from blender_addon.scene.nodes import add, compute_vector, fresh_tree, output, texture
from blender_addon.scene.render import Crop, prepare, render_linear
from blender_addon.scene.vehicle import SceneVehicle
from rauca_core.contract import Camera, Progress, Quality, load_vehicle
from rauca_core.contract.schema import Fields

FILTER_PX = {"coverage": 1.5, "premultiplied": 1.5, "uv": 0.01}


def main(folder: str, cameras_json: list[Any], boxes: list[list[int]], jobs: list[tuple[str, int, int]]) -> None:
    """Render ``jobs``: what, camera's number, samples; write ``folder/<number>.npy``, (H, W, 3) float32 linear.

    ``folder`` holds ``vehicle`` and ``uv_map_linear.npy``; pixels outside of a camera's box (x0, y0, x1, y1) are 0.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    prepare(scene)
    scene.render.film_transparent = True
    vehicle = load_vehicle(Path(folder) / "vehicle", read_image_blender)
    placed = SceneVehicle(scene, vehicle)
    mask = float_image("mask", blender_pixels(vehicle.paint_mask.astype(np.float32)[..., None].repeat(3, 2) / 255))
    colors = float_image("map", blender_pixels(np.load(Path(folder) / "uv_map_linear.npy")))
    views = [Camera.from_json(Fields(camera, "camera")) for camera in cameras_json]
    shown = None
    for number, (what, view, samples) in enumerate(jobs):
        if what != shown:
            for spec, material in zip(vehicle.materials, placed.materials, strict=True):
                emit(material, what if spec.kind == "paint" else "", mask, colors)
            shown = what
        scene.cycles.filter_width = FILTER_PX[what]
        cameras.place(scene, views[view])
        crop = Crop(*boxes[view])
        image = np.zeros((views[view].height, views[view].width, 3), np.float32)
        # Another count is another draw.
        quality = Quality(samples, denoise=False, bounces=0)
        image[crop.inside] = render_linear(scene, quality, samples, crop)[..., :3]
        np.save(Path(folder) / f"{number}.npy", image)
        print(Progress(number + 1, len(jobs), what).line(), flush=True)


def emit(material: bpy.types.Material, what: str, mask: bpy.types.Image, colors: bpy.types.Image) -> None:
    """Make a material pure emission of what a job shows; black if that is nothing."""
    tree = fresh_tree(material)
    color: Any = (0.0, 0.0, 0.0, 1.0)
    uv = add(tree, "ShaderNodeTexCoord").outputs["UV"]
    if what == "uv":
        color = compute_vector(tree, "ADD", uv, (0.0, 0.0, 1.0))
    elif what:
        color = texture(tree, mask, uv).outputs["Color"]
        if what == "premultiplied":
            color = compute_vector(tree, "MULTIPLY", color, texture(tree, colors, uv).outputs["Color"])
    output(tree, Surface=add(tree, "ShaderNodeEmission", Color=color).outputs[0])
