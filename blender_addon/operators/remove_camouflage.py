"""Take the camouflage off the vehicle."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ..core import contract
from ..scene.mesh_edits import object_mode
from ..scene.painting import painted_objects, uncoat
from .on_vehicle import coat_shown
from .operator import RaucaOperator


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


CLASSES = (RAUCA_OT_remove_camouflage,)
