"""Give the vehicle a second UV layer, for baking into."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ..scene.mesh_edits import object_mode
from ..scene.smart_project import add_layer
from .on_vehicle import coat_shown, painted_surface
from .operator import RaucaOperator


class RAUCA_OT_new_uv_layer(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Add a UV layer in which Blender's Smart UV Project lays out the vehicle's paint"""

    bl_idname = "rauca.new_uv_layer"
    bl_label = "New UV Layer"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        return rpt("Apply a camouflage first") if coat_shown(context) is None else ""

    def work(self, context: bpy.types.Context) -> str:
        with object_mode(context):
            surface, _ = painted_surface(context)
            name = add_layer(surface)
        context.scene.rauca.bake.layer = name
        return rpt("UV layer {name} added").format(name=name)


CLASSES = (RAUCA_OT_new_uv_layer,)
