"""Remove the street around the vehicle."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ..scene import street
from .operator import RaucaOperator


class RAUCA_OT_remove_street(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Remove the street and everything that came with it; objects of your own among the houses stay"""

    bl_idname = "rauca.remove_street"
    bl_label = "Remove Street"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        if context.mode != "OBJECT":
            return rpt("Leave edit mode first")
        if context.scene.rauca.weather.street is None:
            return rpt("This scene has no street")
        return ""

    def work(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca.weather
        built = settings.street
        street.remove(context.scene, built)
        settings.street, settings.street_turn_deg = None, 0.0
        settings.refresh()


CLASSES = (RAUCA_OT_remove_street,)
