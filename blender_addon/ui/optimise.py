"""Step 5: optimise a camouflage on the data set, in an external Python."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface

from .panel import StepPanel
from .state import State


class RaucaOptimise(bpy.types.PropertyGroup):
    """Settings of the optimisation."""


def state(context: bpy.types.Context) -> State:
    return State("missing", iface("Run rauca optimize on the data set's folder in a terminal"))


class RAUCA_PT_optimise(StepPanel, bpy.types.Panel):  # noqa: N801 - Blender wants this form
    """Optimise a camouflage"""

    bl_idname = "RAUCA_PT_optimise"
    bl_label = "Optimise"
    number = 5
    step_state = staticmethod(state)


CLASSES = (RaucaOptimise, RAUCA_PT_optimise)
