"""Step 7: carry the camouflage to another UV layout."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface

from .panel import StepPanel
from .state import State


class RaucaBake(bpy.types.PropertyGroup):
    """Settings of the bake."""


def state(context: bpy.types.Context) -> State:
    return State("missing", iface("Apply a camouflage first"))


class RAUCA_PT_bake(StepPanel, bpy.types.Panel):  # noqa: N801 - Blender wants this form
    """Bake the camouflage to other UVs"""

    bl_idname = "RAUCA_PT_bake"
    bl_label = "Bake"
    number = 7
    step_state = staticmethod(state)


CLASSES = (RaucaBake, RAUCA_PT_bake)
