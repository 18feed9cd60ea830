"""Build a street of the dataset around the vehicle."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ..scene import street
from ..ui.cameras.anchor import anchor
from .operator import RaucaOperator


class RAUCA_OT_set_up_street(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Build a street of the dataset's town around the vehicle, which stays where it is"""

    bl_idname = "rauca.set_up_street"
    bl_label = "Set Up a Street"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute

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


CLASSES = (RAUCA_OT_set_up_street,)
