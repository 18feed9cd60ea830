"""Show the weather of the sliders in the open scene."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from .operator import RaucaOperator


class RAUCA_OT_show_weather(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Put sky, sun, clouds and fog into this scene; your own world is kept and comes back with Remove Weather"""

    bl_idname = "rauca.show_weather"
    bl_label = "Show in This Scene"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        if context.scene.library is not None:
            return rpt("This scene is linked from another file: open that file")
        return ""

    def work(self, context: bpy.types.Context) -> None:
        context.scene.rauca.weather.show()


CLASSES = (RAUCA_OT_show_weather,)
