"""The round trip of a bake: a camouflage carried to another UV layout, rendered, and held against itself.

``python -m benchmarks.bake_round_trip --vehicle sedan --camouflage FILE.json [--size 2048]`` prints a line of JSON;
needs the bpy wheel. A vehicle without a camouflage gets one of random texels, the hardest to carry.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from blender_addon.scene import bake
from blender_addon.scene import camera as cameras
from blender_addon.scene.camouflages import Paintwork, read_paintwork
from blender_addon.scene.coating import Coat, paint_surface
from blender_addon.scene.mesh_edits import Surface
from blender_addon.scene.nodes import add, fresh_tree
from blender_addon.scene.render import prepare, render_linear
from blender_addon.scene.vehicle import SceneVehicle
from blender_addon.vehicles import find_vehicle
from rauca_core import contract
from rauca_core.contract import VehicleSource, color

FOV_DEG = 40.0
ELEVATION_DEG, DISTANCES = 12.0, (1.6, 3.2)  # distances in vehicle lengths
CHANGED = 1e-3  # of linear radiance: where the camouflage changes a pixel, there is paint


@dataclass(frozen=True)
class RoundTrip:
    """PSNR of display values, dB: over the pixels that show the vehicle, and over those that show its paint."""

    vehicle_db: float
    paint_db: float


def look_around(surface: Surface, size: int, azimuths: Sequence[float]) -> list[contract.Camera]:
    """Cameras around the vehicle where it stands, near and far, ``size`` pixels square; azimuths in degrees."""
    low, high = surface.soup.positions.min(axis=0), surface.soup.positions.max(axis=0)
    center, length = (low + high) / 2, float((high - low).max())
    up = np.radians(ELEVATION_DEG)
    views = []
    for distance in DISTANCES:
        for azimuth in np.radians(azimuths):
            toward = np.array([np.cos(up) * np.cos(azimuth), np.cos(up) * np.sin(azimuth), np.sin(up)])
            eye = center + toward * distance * length
            views.append(contract.Camera.look_at(eye, center, FOV_DEG, size, size))
    return views


def round_trip(scene: bpy.types.Scene, coat: Coat, views: Sequence[contract.Camera], samples: int = 16) -> RoundTrip:
    """Render ``scene`` with the camouflage and with its bake, same noise, and compare.

    The scene's lights and world are taken as they are; its camera, its engine's settings and what is shown change.
    """
    prepare(scene)
    scene.render.film_transparent = True
    quality = contract.Quality(samples, denoise=False)
    errors: list[NDArray[np.float64]] = []
    painted: list[NDArray[np.bool_]] = []
    for view in views:
        cameras.place(scene, view)
        shown = {}
        for which in ("ORIGINAL", "CAMOUFLAGE", "BAKED"):
            coat.show(which)
            shown[which] = render_linear(scene, quality, seed=1)
        there = shown["CAMOUFLAGE"][..., 3] > 0.5
        direct, baked = (color.linear_to_srgb(shown[w][..., :3][there]) for w in ("CAMOUFLAGE", "BAKED"))
        changed = np.abs(shown["CAMOUFLAGE"] - shown["ORIGINAL"])[..., :3].max(axis=2) > CHANGED
        errors.append(((direct - baked).astype(np.float64) ** 2).mean(axis=1))
        painted.append(changed[there])
    error, paint = np.concatenate(errors), np.concatenate(painted)
    return RoundTrip(_psnr(error), _psnr(error[paint]))


def daylight(scene: bpy.types.Scene) -> None:
    """A sun and a bright sky of one color: light that shows every texel alike."""
    sun = bpy.data.objects.new("rauca sun", bpy.data.lights.new("rauca sun", "SUN"))
    sun.data.energy = 2.0
    sun.rotation_euler = (0.6, 0.3, 0.0)
    scene.collection.objects.link(sun)
    world = scene.world = bpy.data.worlds.new("rauca sky")
    tree = fresh_tree(world)
    sky = add(tree, "ShaderNodeBackground", Color=(0.7, 0.8, 1.0, 1.0), Strength=0.8)
    add(tree, "ShaderNodeOutputWorld", Surface=sky.outputs[0])


def _psnr(squared: NDArray[np.float64]) -> float:
    return float(-10 * np.log10(max(float(squared.mean()), 1e-12))) if len(squared) else float("nan")


def measure(options: argparse.Namespace) -> dict[str, object]:
    """Place the vehicle, paint it, lay it out anew, bake, render both."""

    bpy.ops.wm.read_factory_settings(use_empty=True)
    vehicle = find_vehicle(VehicleSource(options.vehicle, options.paint_mask, options.paint_material))
    if options.camouflage is not None:
        paintwork = read_paintwork(options.camouflage, vehicle.atlas_id)
    else:
        paintwork = Paintwork("random", np.random.default_rng(0).integers(0, 256, (1024, 1024, 3)).astype(np.uint8), "")
    placed = SceneVehicle(bpy.context.scene, vehicle)
    bpy.context.view_layer.update()
    surface = Surface.of(vehicle, [placed.object])
    coat = paint_surface(surface, paintwork)
    layer = bake.add_layer(surface)
    task = bake.prepare_bake(surface, coat, layer, options.size, allow_overlaps=False)
    baked = bake.run_bake(task, lambda done: None)
    bake.show_baked(surface, coat, layer, task.wraps, bake.baked_image(baked))
    daylight(bpy.context.scene)
    seen = round_trip(bpy.context.scene, coat, look_around(surface, options.pixels, (30, 210)), options.samples)
    texels = {"texel_db": baked.psnr_db, "mean_difference": baked.difference}
    return {"vehicle": vehicle.name, "camouflage": paintwork.name, "size": options.size, **asdict(seen), **texels}


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicle", default="sedan", help="a shipped vehicle's name or a file")
    parser.add_argument("--camouflage", type=Path, help="its .json")
    parser.add_argument("--paint-mask", type=Path)
    parser.add_argument("--paint-material")
    parser.add_argument("--size", type=int, default=2048, help="of the baked image, texels")
    parser.add_argument("--pixels", type=int, default=256, help="width and height of the renders")
    parser.add_argument("--samples", type=int, default=4)
    return parser.parse_args(arguments)


if __name__ == "__main__":
    print(json.dumps(measure(parse())))
