"""Step 3: the cameras around the vehicle."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface

from ..core import contract
from .panel import StepPanel
from .state import State


class RaucaCameras(bpy.types.PropertyGroup):
    """The rings of cameras."""

    azimuths: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Azimuths", default=8, min=1, max=360, description="Cameras on each ring around the vehicle"
    )

    def ring(self, context: bpy.types.Context) -> contract.Ring:
        """Where the cameras of the jobs stand."""
        return contract.Ring(tuple(i * 360.0 / self.azimuths for i in range(self.azimuths)), (10.0, 25.0), (6.0, 10.0))


def state(context: bpy.types.Context) -> State:
    count = context.scene.rauca.cameras.azimuths
    return State("done", iface("{count} cameras on each ring").format(count=count))


class RAUCA_PT_cameras(StepPanel, bpy.types.Panel):  # noqa: N801 - Blender wants this form
    """Place the cameras"""

    bl_idname = "RAUCA_PT_cameras"
    bl_label = "Cameras"
    number = 3
    step_state = staticmethod(state)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        layout.prop(context.scene.rauca.cameras, "azimuths")


CLASSES = (RaucaCameras, RAUCA_PT_cameras)
