"""Put a camouflage on its vehicle in the open scene."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..core import contract
from ..scene.apply import apply_camouflage
from .operator import RaucaOperator


class RAUCA_OT_apply_camouflage(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Add the vehicle to the scene, painted with the chosen camouflage"""

    bl_idname = "rauca.apply_camouflage"
    bl_label = "Apply camouflage"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute

    def work(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca
        if not settings.camouflage.file:
            raise contract.RaucaError("Choose a camouflage's .json file")
        vehicle = settings.vehicle.chosen(context)
        apply_camouflage(context.scene, vehicle, Path(bpy.path.abspath(settings.camouflage.file)))


CLASSES = (RAUCA_OT_apply_camouflage,)
