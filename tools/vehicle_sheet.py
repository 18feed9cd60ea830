"""A picture of all procedural vehicles: ``python -m tools.vehicle_sheet docs/pictures/vehicles.jpg``."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from blender_addon import compat
from blender_addon.scene import camera, nodes, render
from blender_addon.scene.vehicle import SceneVehicle
from rauca_core.contract import Camera, Quality, Vehicle, load_vehicle
from rauca_core.contract.assets import assets_folder
from rauca_core.contract.color import linear_to_srgb, to_bytes
from rauca_core.runtime.images import read_image

# Name, camera azimuth and distance over the vehicle's size, paint (linear albedo).
SHOWN = [
    ("sedan", 35, 1.55, (0.42, 0.03, 0.03)),
    ("hatchback", 140, 1.6, (0.05, 0.16, 0.42)),
    ("suv", 35, 1.65, (0.06, 0.18, 0.09)),
    ("van", 40, 1.6, (0.75, 0.72, 0.66)),
    ("aeroplane", 40, 1.45, (0.70, 0.72, 0.75)),
    ("boat", 40, 1.55, (0.06, 0.30, 0.36)),
    ("boat_detailed", 40, 1.5, (0.03, 0.07, 0.20)),
    ("cylinder", 35, 1.9, (0.62, 0.33, 0.04)),
    ("cube", 30, 3.0, (0.40, 0.06, 0.22)),
    ("sphere", 30, 2.4, (0.45, 0.45, 0.45)),
]
COLUMNS, WIDTH, HEIGHT = 5, 300, 225


def main(out: Path) -> None:
    """Render every vehicle in car paint under a clear sky and lay the pictures out with their names."""
    rows = math.ceil(len(SHOWN) / COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * WIDTH, rows * HEIGHT))
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(15)
    for i, (name, azimuth, distance, paint) in enumerate(SHOWN):
        vehicle = load_vehicle(assets_folder() / "vehicles" / name, read_image)
        corner = (i % COLUMNS * WIDTH, i // COLUMNS * HEIGHT)
        sheet.paste(Image.fromarray(picture(vehicle, azimuth, distance, paint)), corner)
        label = "{}  {:.1f} x {:.1f} x {:.1f} m".format(name, *vehicle.size())
        draw.text((corner[0] + 8, corner[1] + HEIGHT - 24), label, "white", font)
    sheet.save(out, quality=88)


def picture(
    vehicle: Vehicle,
    azimuth_deg: float,
    distance: float,
    paint: tuple[float, float, float],
    width: int = WIDTH,
    height: int = HEIGHT,
) -> NDArray[np.uint8]:
    """(height, width, 3) sRGB view of a vehicle from ``distance`` times its size."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.data.scenes.new("sheet")
    render.prepare(scene)
    _surroundings(scene)
    placed = SceneVehicle(scene, vehicle, "car_paint")
    placed.paint.set_color(paint)
    azimuth, elevation = math.radians(azimuth_deg), math.radians(14)
    flat = math.cos(elevation)
    ahead = np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)])
    eye = placed.center + distance * max(vehicle.size()) * ahead
    camera.place(scene, Camera.look_at(eye, placed.center, 40, width, height))
    return to_bytes(linear_to_srgb(render.render_linear(scene, Quality(samples=16), 1)[..., :3]))


def _surroundings(scene: bpy.types.Scene) -> None:
    """A grey ground that fills the view, and a sky whose sun lights the side that the camera sees."""
    mesh = bpy.data.meshes.new("ground")
    mesh.from_pydata([(-900, -900, 0), (900, -900, 0), (900, 900, 0), (-900, 900, 0)], [], [(0, 1, 2, 3)])
    material = bpy.data.materials.new("ground")
    tree = nodes.fresh_tree(material)
    nodes.output(tree, Surface=nodes.add(tree, "ShaderNodeBsdfDiffuse", Color=(0.20, 0.20, 0.21, 1)).outputs[0])
    mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("ground", mesh))
    scene.world = bpy.data.worlds.new("sky")
    tree = nodes.fresh_tree(scene.world)
    sky = nodes.add(tree, "ShaderNodeTexSky")
    sky.sky_type = compat.sky_texture_kind()
    sky.sun_elevation, sky.sun_rotation = math.radians(42), math.radians(25)
    background = nodes.add(tree, "ShaderNodeBackground", Color=sky.outputs[0])
    tree.links.new(background.outputs[0], nodes.add(tree, "ShaderNodeOutputWorld").inputs["Surface"])
    scene.cycles.film_exposure = 2.0**-5.1


if __name__ == "__main__":
    main(Path(sys.argv[1]))
