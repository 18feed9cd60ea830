"""Step 1: which vehicle, and what of it is paint."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface

from ..core import contract
from ..vehicles import find_vehicle
from .panel import StepPanel
from .state import State


class RaucaVehicle(bpy.types.PropertyGroup):
    """The vehicle that the other steps work on."""

    origin: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="From",
        items=[("FILE", "File", "A vehicle's file or folder")],
        description="Where the vehicle comes from",
    )
    file: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Vehicle", default="sedan", description="A shipped vehicle's name, or an .obj, .glb or .blend file"
    )

    def chosen(self, context: bpy.types.Context) -> contract.Vehicle:
        """The vehicle as every job and every other step uses it.

        Raises:
            RaucaError: none is chosen, or it cannot be used; says what to do.
        """
        if not self.file:
            raise contract.RaucaError("No vehicle: choose one in step 1, Vehicle")
        return find_vehicle(self.file, None, None)


def state(context: bpy.types.Context) -> State:
    """Quick: looks at the settings only."""
    settings = context.scene.rauca.vehicle
    if not settings.file:
        return State("missing", iface("Choose a vehicle"))
    return State("done", iface("The vehicle is {name}").format(name=settings.file))


class RAUCA_PT_vehicle(StepPanel, bpy.types.Panel):  # noqa: N801 - Blender wants this form
    """Choose the vehicle"""

    bl_idname = "RAUCA_PT_vehicle"
    bl_label = "Vehicle"
    number = 1
    step_state = staticmethod(state)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        layout.prop(context.scene.rauca.vehicle, "file")


CLASSES = (RaucaVehicle, RAUCA_PT_vehicle)
