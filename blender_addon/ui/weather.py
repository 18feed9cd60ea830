"""Step 2: the weathers in which every view is rendered."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface

from ..core import assets
from .panel import StepPanel
from .state import State


def _presets(self: bpy.types.PropertyGroup, context: bpy.types.Context | None) -> list[tuple[str, str, str]]:
    names = sorted(p.stem for p in (assets.assets_folder() / "weathers").glob("*.json"))
    return [(name, name.capitalize(), f"Weathers of the preset {name}") for name in names]


class RaucaWeather(bpy.types.PropertyGroup):
    """The weathers of the data set."""

    preset: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Weathers", items=_presets, description="Every view is rendered in each weather of this preset"
    )

    def preset_file(self, context: bpy.types.Context) -> str:
        """What ``--weathers`` of the jobs takes: a preset's name or a file."""
        return str(self.preset)


def state(context: bpy.types.Context) -> State:
    return State("done", iface("Weathers of the preset {name}").format(name=context.scene.rauca.weather.preset))


class RAUCA_PT_weather(StepPanel, bpy.types.Panel):  # noqa: N801 - Blender wants this form
    """Choose the weathers"""

    bl_idname = "RAUCA_PT_weather"
    bl_label = "Weather"
    number = 2
    step_state = staticmethod(state)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        layout.prop(context.scene.rauca.weather, "preset")


CLASSES = (RaucaWeather, RAUCA_PT_weather)
