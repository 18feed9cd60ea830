"""Runs in a process of its own, with Blender: a vehicle's paint in Cycles as pure emission, seen by many cameras.

Usage: python -m benchmarks.render_in_blender INPUT.npz OUTPUT.npz

Input: positions, triangles, uvs, paint, mask of the vehicle; uv_map_linear (H, W, 3); K, R, t of N cameras; size,
pixels; jobs, JSON ``[[what, camera, samples], ...]``. What is rendered:

- ``coverage``: the paint mask, with Cycles' default pixel filter;
- ``premultiplied``: mask times map, linear, with the same filter;
- ``uv``: u, v, 1 of the paint at the pixel's center, through the narrowest filter there is.

Output: per job an array (size, size, 3) float32 under its number. No light, no bounces: what is seen is the texture,
visibility and anti-aliasing alone. Progress is one marked JSON line per job.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

SENSOR_MM = 36.0
NARROWEST = 0.01  # pixels
REACH = 2  # pixels around the car that the filter may touch


def build_mesh(data: dict[str, np.ndarray]) -> bpy.types.Object:
    mesh = bpy.data.meshes.new("vehicle")
    triangles = data["triangles"].reshape(-1, 3)
    mesh.from_pydata(data["positions"].tolist(), [], triangles.tolist())
    layer = mesh.uv_layers.new(name="uv")
    layer.data.foreach_set("uv", data["uvs"].reshape(-1).astype(np.float32))
    thing = bpy.data.objects.new("vehicle", mesh)
    for name in ("paint", "rest"):
        mesh.materials.append(bpy.data.materials.new(name))
    mesh.polygons.foreach_set("material_index", np.where(data["paint"], 0, 1).astype(np.int32))
    bpy.context.scene.collection.objects.link(thing)
    return thing


def image(name: str, pixels: np.ndarray) -> bpy.types.Image:
    height, width = pixels.shape[:2]
    result = bpy.data.images.new(name, width, height, float_buffer=True, is_data=True)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = pixels[::-1]
    result.pixels.foreach_set(rgba.ravel())
    result.update()
    return result


def emission(material: bpy.types.Material) -> tuple[bpy.types.NodeTree, bpy.types.NodeSocket]:
    """Make a material pure emission, black; returns its nodes and the socket of its color."""
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    node = tree.nodes.new("ShaderNodeEmission")
    node.inputs["Color"].default_value = (0, 0, 0, 1)
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    return tree, node.inputs["Color"]


def emit_product(material: bpy.types.Material, images: list[bpy.types.Image]) -> None:
    """Emit the product of one or two images."""
    tree, color = emission(material)
    sockets = []
    for source in images:
        texture = tree.nodes.new("ShaderNodeTexImage")
        texture.image, texture.interpolation, texture.extension = source, "Linear", "EXTEND"
        sockets.append(texture.outputs["Color"])
    if len(sockets) == 2:
        sockets = [vector_math(tree, "MULTIPLY", *sockets)]
    tree.links.new(sockets[0], color)


def emit_uv(material: bpy.types.Material) -> None:
    """Emit (u, v, 1)."""
    tree, color = emission(material)
    place = tree.nodes.new("ShaderNodeTexCoord")
    marked = vector_math(tree, "ADD", place.outputs["UV"])
    marked.node.inputs[1].default_value = (0.0, 0.0, 1.0)
    tree.links.new(marked, color)


def vector_math(tree: bpy.types.NodeTree, operation: str, *sockets: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = operation
    for source, target in zip(sockets, node.inputs, strict=False):
        tree.links.new(source, target)
    return node.outputs[0]


def set_up(size: int) -> bpy.types.Scene:
    scene = bpy.context.scene
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    scene.render.engine = "CYCLES"
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.film_transparent = True
    scene.render.use_persistent_data = True
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.cycles.max_bounces = 0
    scene.cycles.pixel_filter_type = "BLACKMAN_HARRIS"
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.sensor_width, camera.data.clip_start = SENSOR_MM, 0.02
    scene.collection.objects.link(camera)
    scene.camera = camera
    return scene


def aim(scene: bpy.types.Scene, K: np.ndarray, R: np.ndarray, t: np.ndarray, positions: np.ndarray) -> None:
    """Place the camera, and render only the part of the frame where the vehicle may be."""
    size = scene.render.resolution_x
    scene.camera.data.lens = float(K[0, 0]) * SENSOR_MM / size
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R.T @ np.diag([1.0, -1.0, -1.0]), -R.T @ t
    scene.camera.matrix_world = Matrix(pose.tolist())
    local = positions @ R.T + t
    scene.render.use_border = bool((local[:, 2] > 0.02).all())
    if scene.render.use_border:
        pixels = (local @ K.T)[:, :2] / local[:, 2:]
        low, high = np.floor(pixels.min(0)) - REACH, np.ceil(pixels.max(0)) + REACH
        (x0, y0), (x1, y1) = np.clip(low, 0, size) / size, np.clip(high, 0, size) / size
        scene.render.border_min_x, scene.render.border_max_x = x0, x1
        scene.render.border_min_y, scene.render.border_max_y = 1 - y1, 1 - y0


def render(scene: bpy.types.Scene, folder: Path) -> np.ndarray:
    scene.render.filepath = str(folder / "view.exr")
    bpy.ops.render.render(write_still=True)
    result = bpy.data.images.load(scene.render.filepath)
    pixels = np.empty(len(result.pixels), np.float32)
    result.pixels.foreach_get(pixels)
    bpy.data.images.remove(result)
    size = scene.render.resolution_x
    return pixels.reshape(size, size, 4)[::-1, :, :3].copy()


def main(source: str, target: str) -> None:
    with np.load(source) as archive:
        data = dict(archive)
    scene = set_up(int(data["size"]))
    paint, rest = build_mesh(data).data.materials
    emission(rest)
    mask = image("mask", data["mask"].astype(np.float32)[..., None].repeat(3, 2) / 255)
    colors = image("map", data["uv_map_linear"])
    paints = {
        "coverage": lambda: emit_product(paint, [mask]),
        "premultiplied": lambda: emit_product(paint, [mask, colors]),
        "uv": lambda: emit_uv(paint),
    }
    jobs, painted, results = json.loads(str(data["jobs"])), None, {}
    with tempfile.TemporaryDirectory() as folder:
        for number, (what, camera, samples) in enumerate(jobs):
            if what != painted:
                paints[what]()
                painted = what
            scene.cycles.samples = scene.cycles.seed = samples  # another count is another draw
            scene.cycles.filter_width = NARROWEST if what == "uv" else 1.5
            aim(scene, data["K"][camera], data["R"][camera], data["t"][camera], data["positions"].astype(np.float64))
            results[str(number)] = render(scene, Path(folder))
            news = {"done": number + 1, "total": len(jobs), "last": what}
            print("rauca-progress " + json.dumps(news), flush=True)
    np.savez(target, **results)


if __name__ == "__main__":
    main(*sys.argv[1:])
