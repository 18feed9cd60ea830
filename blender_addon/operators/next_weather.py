"""Step through the weathers of the list."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from .operator import RaucaOperator


class RAUCA_OT_next_weather(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Go on to the next weather of the list; after the last comes the first"""

    bl_idname = "rauca.next_weather"
    bl_label = "Next Weather"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute

    step: bpy.props.IntProperty(name="Step", default=1, options={"SKIP_SAVE"})  # type: ignore[valid-type]

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        if properties.step < 0:
            return bpy.app.translations.pgettext_tip("Go back to the weather before; before the first comes the last")
        return bpy.app.translations.pgettext_tip(str(cls.__doc__))

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        if not context.scene.rauca.weather.listed():
            return rpt("The list of weathers is empty: choose another list or file")
        return ""

    def work(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca.weather
        weathers = settings.listed()
        names = [weather.name for weather in weathers]
        # From a weather of the sliders' own, forward leads to the picked one's neighbor all the same.
        number = names.index(settings.picked) if settings.picked in names else -1
        settings.pick(weathers[(number + self.step) % len(weathers)])


CLASSES = (RAUCA_OT_next_weather,)
