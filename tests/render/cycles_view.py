"""Run in a process of its own: render a vehicle's paint in Cycles as pure emission, to compare the taps with.

Usage: python cycles_view.py INPUT.npz OUTPUT.npz

Input: positions, triangles, uvs, paint, mask, uv_map_linear (H, W, 3), K, R, t, size, samples.
Output: coverage (H, W), premultiplied (H, W, 3), linear.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix


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


def emit(material: bpy.types.Material, images: list[bpy.types.Image]) -> None:
    """Emission of the product of ``images``; black without any."""
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    emission = tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Color"].default_value = (0, 0, 0, 1)
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    socket = None
    for source in images:
        texture = tree.nodes.new("ShaderNodeTexImage")
        texture.image, texture.interpolation, texture.extension = source, "Linear", "EXTEND"
        if socket is None:
            socket = texture.outputs["Color"]
            continue
        product = tree.nodes.new("ShaderNodeVectorMath")
        product.operation = "MULTIPLY"
        tree.links.new(socket, product.inputs[0])
        tree.links.new(texture.outputs["Color"], product.inputs[1])
        socket = product.outputs[0]
    if socket is not None:
        tree.links.new(socket, emission.inputs["Color"])


def set_up(data: dict[str, np.ndarray]) -> bpy.types.Scene:
    scene = bpy.context.scene
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    size = int(data["size"])
    scene.render.engine = "CYCLES"
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.film_transparent = True
    scene.cycles.samples, scene.cycles.use_adaptive_sampling, scene.cycles.use_denoising = (
        int(data["samples"]),
        False,
        False,
    )
    scene.cycles.max_bounces = 0
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BLACKMAN_HARRIS", 1.5
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    lens = bpy.data.cameras.new("camera")
    camera = bpy.data.objects.new("camera", lens)
    scene.collection.objects.link(camera)
    scene.camera = camera
    K, R, t = data["K"], data["R"], data["t"]
    lens.sensor_width, lens.clip_start = 36.0, 0.02
    lens.lens = float(K[0, 0]) * 36.0 / size
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R.T @ np.diag([1.0, -1.0, -1.0]), -R.T @ t
    camera.matrix_world = Matrix(pose.tolist())
    return scene


def render(scene: bpy.types.Scene) -> np.ndarray:
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "view.exr")
        bpy.ops.render.render(write_still=True)
        result = bpy.data.images.load(scene.render.filepath)
        pixels = np.empty(len(result.pixels), np.float32)
        result.pixels.foreach_get(pixels)
        size = scene.render.resolution_x
    return pixels.reshape(size, size, 4)[::-1, :, :3]


def main(source: str, target: str) -> None:
    with np.load(source) as archive:
        data = dict(archive)
    scene = set_up(data)
    thing = build_mesh(data)
    paint, rest = thing.data.materials
    mask = image("mask", data["mask"].astype(np.float32)[..., None].repeat(3, 2) / 255)
    emit(rest, [])
    emit(paint, [mask])
    coverage = render(scene)[..., 0]
    emit(paint, [mask, image("map", data["uv_map_linear"])])
    np.savez(target, coverage=coverage, premultiplied=render(scene))


if __name__ == "__main__":
    main(*sys.argv[1:])
