"""A scene to try everything with: a vehicle in a street, its weather, few cameras, and folders for what comes of it."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_rpt as rpt
from mathutils import Euler

from .. import compat
from ..core import contract
from ..folders import own_folder
from .dataset import samples_without_denoiser
from .operator import NOT_OBJECT_MODE, RaucaOperator

VEHICLE = "sedan"
AROUND, STEPS, SIZE, MAP_SIZE = 4, 50, 256, 512  # 12 frames: 4 views in 3 weathers
EVALUATED = 2  # views in each of two sets of weathers


class RAUCA_OT_demo_scene(RaucaOperator, bpy.types.Operator):
    """Add a scene to this file in which every step can be tried: a sedan in a street, and 12 small frames to render"""

    bl_label = "Demo Scene"
    obstacles = (NOT_OBJECT_MODE,)

    def work(self, context: bpy.types.Context) -> str:
        scene = bpy.data.scenes.new("Rauca Demo")
        if context.window is None:
            bpy.data.scenes.remove(scene)
            raise contract.RaucaError("There is no window to show a scene in")
        context.window.scene = scene
        steps, folder = scene.rauca, demo_folder()
        bpy.ops.rauca.add_vehicle(vehicle=VEHICLE)
        steps.weather.preset = "demo"
        steps.cameras.azimuths, steps.cameras.elevations, steps.cameras.distances = AROUND, 1, 1
        steps.cameras.overlay = False  # lines over the car hide it from a first look
        steps.dataset.folder, steps.dataset.size = str(folder / "dataset"), SIZE
        if not compat.has_denoiser():
            steps.dataset.denoise = False
            steps.dataset.samples = samples_without_denoiser(steps.dataset.samples)
        steps.optimize.folder, steps.optimize.title = str(folder / "camouflage"), "demo"
        steps.optimize.steps, steps.optimize.map_size = STEPS, MAP_SIZE
        steps.evaluate.folder, steps.evaluate.size = str(folder / "evaluated"), SIZE
        steps.evaluate.frames = EVALUATED
        steps.bake.folder = str(folder / "baked")
        bpy.ops.rauca.set_up_street()
        steps.weather.show()
        bpy.ops.rauca.look_through(step=0)
        _show(context)
        return rpt("Demo scene added; go through the steps one by one")


def demo_folder() -> Path:
    """Where the demo's results go: a folder of the user's own that outlives the extension's updates."""
    return own_folder() / "demo"


def _show(context: bpy.types.Context) -> None:
    """Look at it from the front and the side, in the material preview, under the weather's own sky."""
    space = context.space_data
    if space is not None and space.type == "VIEW_3D":
        space.shading.type = "MATERIAL"
        space.shading.use_scene_world = space.shading.use_scene_lights = True
        view = space.region_3d
        view.view_perspective, view.view_location, view.view_distance = "PERSP", (0.0, 0.0, 0.7), 10.0
        view.view_location += context.scene.cursor.location
        view.view_rotation = Euler((math.radians(78.0), 0.0, math.radians(68.0))).to_quaternion()
