"""What the buttons of step 2 do."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ...scene import shown_weather, street
from ..cameras.properties import anchor
from ..operator import RaucaOperator


class RAUCA_OT_show_weather(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Put sky, sun, clouds and fog into this scene; your own world is kept and comes back with Remove Weather"""

    bl_idname = "rauca.show_weather"
    bl_label = "Show in This Scene"

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        if context.scene.library is not None:
            return rpt("This scene is linked from another file: open that file")
        return ""

    def work(self, context: bpy.types.Context) -> None:
        context.scene.rauca.weather.show()


class RAUCA_OT_remove_weather(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Bring back your own world and settings; exactly what was added goes"""

    bl_idname = "rauca.remove_weather"
    bl_label = "Remove Weather"

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        return rpt("This scene shows no weather") if not context.scene.rauca.weather.shown.on else ""

    def work(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca.weather
        shown_weather.remove(context.scene, settings.shown, street.lamps(settings.street))


class RAUCA_OT_next_weather(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Go on to the next weather of the list; after the last comes the first"""

    bl_idname = "rauca.next_weather"
    bl_label = "Next Weather"

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


class RAUCA_OT_set_up_street(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Build a street of the dataset's town around the vehicle, which stays where it is"""

    bl_idname = "rauca.set_up_street"
    bl_label = "Set Up a Street"

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        if context.mode != "OBJECT":
            return rpt("Leave edit mode first")
        if context.scene.rauca.weather.street is not None:
            return rpt("This scene has a street: remove it first")
        return ""

    def work(self, context: bpy.types.Context) -> None:
        steps = context.scene.rauca
        settings = steps.weather
        seed = getattr(steps.dataset, "seed", 0)
        built = street.build(context.scene, seed, settings.place - 1, anchor(context).vehicle_to_world)
        settings.street, settings.street_turn_deg = built
        settings.refresh()


class RAUCA_OT_remove_street(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Remove the street and everything that came with it; objects of your own among the houses stay"""

    bl_idname = "rauca.remove_street"
    bl_label = "Remove Street"

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


CLASSES = (
    RAUCA_OT_show_weather,
    RAUCA_OT_remove_weather,
    RAUCA_OT_next_weather,
    RAUCA_OT_set_up_street,
    RAUCA_OT_remove_street,
)
