"""Take the shown weather out of the open scene."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ..scene import shown_weather, street
from .operator import RaucaOperator


class RAUCA_OT_remove_weather(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Bring back your own world and settings; exactly what was added goes"""

    bl_idname = "rauca.remove_weather"
    bl_label = "Remove Weather"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        return rpt("This scene shows no weather") if not context.scene.rauca.weather.shown.on else ""

    def work(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca.weather
        shown_weather.remove(context.scene, settings.shown, street.lamps(settings.street))


CLASSES = (RAUCA_OT_remove_weather,)
