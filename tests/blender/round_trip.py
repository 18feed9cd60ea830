"""The round trip of a bake: a camouflage carried to another UV layout, rendered, and held against itself."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from blender_addon.scene import camera as cameras
from blender_addon.scene.coating import Coat
from blender_addon.scene.mesh_edits import Surface
from blender_addon.scene.nodes import add, fresh_tree
from blender_addon.scene.render import prepare, render_linear
from rauca_core.contract import Camera, Quality, color

CHANGED = 1e-3  # of linear radiance: where the camouflage changes a pixel, there is paint


def look_around(surface: Surface, size: int, azimuth_deg: float) -> list[Camera]:
    """Two cameras at the vehicle where it stands, near and far, ``size`` pixels square."""
    low, high = surface.soup.positions.min(axis=0), surface.soup.positions.max(axis=0)
    center, up, azimuth = (low + high) / 2, np.radians(12), np.radians(azimuth_deg)
    toward = np.array([np.cos(up) * np.cos(azimuth), np.cos(up) * np.sin(azimuth), np.sin(up)])
    eyes = [center + toward * lengths * float((high - low).max()) for lengths in (1.6, 3.2)]
    return [Camera.look_at(eye, center, 40.0, size, size) for eye in eyes]


def daylight(scene: bpy.types.Scene) -> None:
    """A sun and a bright sky of one color: light that shows every texel alike."""
    sun = bpy.data.objects.new("rauca sun", bpy.data.lights.new("rauca sun", "SUN"))
    sun.data.energy = 2.0
    sun.rotation_euler = (0.6, 0.3, 0.0)
    scene.collection.objects.link(sun)
    scene.world = bpy.data.worlds.new("rauca sky")
    tree = fresh_tree(scene.world)
    sky = add(tree, "ShaderNodeBackground", Color=(0.7, 0.8, 1.0, 1.0), Strength=0.8)
    add(tree, "ShaderNodeOutputWorld", Surface=sky.outputs[0])


def round_trip(scene: bpy.types.Scene, coat: Coat, views: Sequence[Camera]) -> tuple[float, float]:
    """PSNR of display values, dB, of the bake against the camouflage: over the vehicle, and over its paint."""
    prepare(scene)
    scene.render.film_transparent = True
    errors, painted = [], []
    for view in views:
        cameras.place(scene, view)
        shown = {}
        for which in ("ORIGINAL", "CAMOUFLAGE", "BAKED"):
            coat.show(which)
            shown[which] = render_linear(scene, Quality(2, denoise=False), seed=1)
        there = shown["CAMOUFLAGE"][..., 3] > 0.5
        direct, baked = (color.linear_to_srgb(shown[w][..., :3][there]) for w in ("CAMOUFLAGE", "BAKED"))
        errors.append(((direct - baked).astype(np.float64) ** 2).mean(axis=1))
        painted.append((np.abs(shown["CAMOUFLAGE"] - shown["ORIGINAL"])[..., :3].max(axis=2) > CHANGED)[there])
    error, paint = np.concatenate(errors), np.concatenate(painted)
    return float(-10 * np.log10(error.mean())), float(-10 * np.log10(error[paint].mean()))
