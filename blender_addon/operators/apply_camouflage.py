"""Put a camouflage on its vehicle in the open scene."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..core import contract
from ..scene.apply import apply_camouflage
from ..vehicles import find_vehicle


class RAUCA_OT_apply_camouflage(bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Add the vehicle to the scene, painted with the chosen camouflage"""

    bl_idname = "rauca.apply_camouflage"
    bl_label = "Apply camouflage"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.rauca
        try:
            if not settings.camouflage:
                raise contract.RaucaError("Choose a camouflage's .json file")
            vehicle = find_vehicle(settings.vehicle, None, None)
            apply_camouflage(context.scene, vehicle, Path(bpy.path.abspath(settings.camouflage)))
        except contract.RaucaError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}
