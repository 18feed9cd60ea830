"""Step 6: put a camouflage on the vehicle."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface

from .panel import StepPanel
from .state import State


class RaucaCamouflage(bpy.types.PropertyGroup):
    """The camouflage to apply."""

    file: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Camouflage", subtype="FILE_PATH", description="A camouflage's .json file"
    )


def state(context: bpy.types.Context) -> State:
    if not context.scene.rauca.camouflage.file:
        return State("missing", iface("Choose a camouflage's .json file"))
    return State("ready", iface("Ready to apply"))


class RAUCA_PT_camouflage(StepPanel, bpy.types.Panel):  # noqa: N801 - Blender wants this form
    """Put a camouflage on the vehicle"""

    bl_idname = "RAUCA_PT_camouflage"
    bl_label = "Apply camouflage"
    number = 6
    step_state = staticmethod(state)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        layout.prop(context.scene.rauca.camouflage, "file")
        layout.operator("rauca.apply_camouflage", icon="TEXTURE")


CLASSES = (RaucaCamouflage, RAUCA_PT_camouflage)
