"""What the buttons of step 6 do, but looking through evaluated views."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from bpy.app.translations import pgettext_rpt as rpt
from mathutils import Matrix

from ...core import contract
from ...scene.camouflages import read_paintwork
from ...scene.mesh_edits import Surface, object_mode
from ...scene.painting import paint_surface, painted_objects, uncoat
from ..operator import RaucaOperator, tooltip
from .evaluation import find_evaluation
from .painted_vehicle import coat_shown, objects_of, place, require_coat, vehicle_for


class RAUCA_OT_apply_camouflage(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Paint the vehicle of step 1 with the chosen camouflage; it is added to the scene if it is not there"""

    bl_idname = "rauca.apply_camouflage"
    bl_label = "Apply Camouflage"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute

    def work(self, context: bpy.types.Context) -> str:
        settings = context.scene.rauca.camouflage
        if not settings.file:
            raise contract.RaucaError("No camouflage: choose its .json or .png file in step 6")
        path = Path(bpy.path.abspath(settings.file))
        with object_mode(context):
            vehicle = vehicle_for(context, path)
            paintwork = read_paintwork(path.with_suffix(".json"), vehicle.atlas_id)
            objects = objects_of(context, vehicle)
            surface = Surface.of(vehicle, objects or place(context, vehicle))
            coat = paint_surface(surface, paintwork)
        settings.coat = coat.tree
        anchor = surface.painted_pieces()[0][0].owner
        settings.anchor = anchor
        to_anchor = np.linalg.inv(np.array(anchor.matrix_world)) @ surface.vehicle_to_world()
        settings.vehicle_to_anchor = [x for row in Matrix(to_anchor.tolist()) for x in row]
        if not settings.study:
            found = find_evaluation(path)
            settings.study = str(found) if found is not None else ""
        return rpt("{name} is on {vehicle}").format(name=paintwork.name, vehicle=vehicle.name)


LOOKS = [
    ("TOGGLE", "Toggle", "The original paint if the camouflage shows, else the camouflage"),
    ("ORIGINAL", "Original", "The vehicle's own paint"),
    ("CAMOUFLAGE", "Camouflage", "The camouflage, in the UV layer that it was made for"),
    ("BAKED", "Baked", "The baked image, in its own UV layer"),
]


class RAUCA_OT_show_paint(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Change between the original paint and the camouflage"""

    bl_idname = "rauca.show_paint"
    bl_label = "Original / Camouflage"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute
    which: bpy.props.EnumProperty(name="Show", items=LOOKS, options={"SKIP_SAVE"})  # type: ignore[valid-type]

    @classmethod
    def description(cls, context: bpy.types.Context, properties: RAUCA_OT_show_paint) -> str:
        return tooltip(LOOKS, properties.which)

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        return rpt("Apply a camouflage first") if coat_shown(context) is None else ""

    def work(self, context: bpy.types.Context) -> None:
        coat = require_coat(context)
        which = self.which
        if which == "TOGGLE":
            which = "CAMOUFLAGE" if coat.shown == "ORIGINAL" else "ORIGINAL"
        if which == "BAKED" and coat.image("baked") is None:
            raise contract.RaucaError("Nothing is baked yet; bake the camouflage first (step 7)")
        coat.show(which)


class RAUCA_OT_remove_camouflage(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Take the camouflage off again: the materials are as they were"""

    bl_idname = "rauca.remove_camouflage"
    bl_label = "Remove Camouflage"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        return rpt("There is no camouflage to remove") if coat_shown(context) is None else ""

    def work(self, context: bpy.types.Context) -> None:
        coat = coat_shown(context)
        if coat is None:
            raise contract.RaucaError("There is no camouflage to remove")
        with object_mode(context):
            uncoat(painted_objects(context.scene, coat))
        context.scene.rauca.camouflage.coat = None


CLASSES = (
    RAUCA_OT_apply_camouflage,
    RAUCA_OT_show_paint,
    RAUCA_OT_remove_camouflage,
)
