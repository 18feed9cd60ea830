"""Measure the round trip of a bake: a camouflage carried to another UV layout, rendered, and held against itself.

``python pipelines/measure_bake.py --vehicle sedan --camouflage FILE.json [--size 2048]`` prints a line of JSON; needs
the bpy wheel. A vehicle without a camouflage gets one of random texels, the hardest to carry.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))


def measure(options: argparse.Namespace) -> dict[str, object]:
    """Place the vehicle, paint it, lay it out anew, bake, render both."""
    import bpy

    from blender_addon.scene import bake
    from blender_addon.scene.bake_check import daylight, look_around, round_trip
    from blender_addon.scene.camouflages import Paintwork, read_paintwork
    from blender_addon.scene.painting import paint_surface
    from blender_addon.scene.second_layer import add_layer
    from blender_addon.scene.surface import Surface
    from blender_addon.scene.vehicle import SceneVehicle
    from blender_addon.vehicles import find_vehicle
    from rauca_core.contract import VehicleSource

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
    task = bake.prepare_bake(surface, coat, add_layer(surface), options.size, allow_overlaps=False)
    baked = bake.run_bake(task, lambda done: None)
    with tempfile.TemporaryDirectory() as folder:
        bake.finish_bake(surface, coat, "baked", task, baked, Path(folder) / "baked.png")
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
