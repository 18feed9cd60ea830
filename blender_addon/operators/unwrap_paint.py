"""Give the vehicle's paint a UV layer of its own."""

from __future__ import annotations

import bpy

from ..core import contract
from ..scene.mesh_edits import object_mode
from ..scene.paint_layer import unwrap_paint
from ..scene.shipped import untouched_shipped
from .operator import RaucaOperator


class RAUCA_OT_unwrap_paint(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Unwrap the paint into a UV layer of its own, without overlaps and at one level of detail; other layers stay"""

    bl_idname = "rauca.unwrap_paint"
    bl_label = "Unwrap"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not context.scene.rauca.vehicle.objects(context):
            cls.poll_message_set("Pick the vehicle's object or collection first")
            return False
        return True

    def work(self, context: bpy.types.Context) -> str:
        settings = context.scene.rauca.vehicle
        with object_mode(context):
            if shipped := untouched_shipped(settings.objects(context), settings.request()):
                raise contract.RaucaError(f"{shipped.name}: has the UV map that its camouflages fit; no need to unwrap")
            done = unwrap_paint(settings.reading(context))
        settings.forget_check()
        text = f"Paint unwrapped into {done.charts} charts"
        if done.how:
            self.report({"WARNING"}, text + done.how)
            return ""
        return text


CLASSES = (RAUCA_OT_unwrap_paint,)
