"""Change between the original paint, the camouflage and the baked picture."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ..core import contract
from .on_vehicle import coat_shown, require_coat
from .operator import RaucaOperator, tooltip

LOOKS = [
    ("TOGGLE", "Toggle", "The original paint if the camouflage shows, else the camouflage"),
    ("ORIGINAL", "Original", "The vehicle's own paint"),
    ("CAMOUFLAGE", "Camouflage", "The camouflage, in the UV layer that it was made for"),
    ("BAKED", "Baked", "The baked image, in its own UV layer"),
]


class RAUCA_OT_show_paint(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Change between the original paint and the camouflage"""

    bl_idname = "rauca.show_paint"
    bl_label = "Original / Camouflage"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute
    which: bpy.props.EnumProperty(name="Show", items=LOOKS, options={"SKIP_SAVE"})  # type: ignore[valid-type]

    @classmethod
    def description(cls, context: bpy.types.Context, properties: RAUCA_OT_show_paint) -> str:
        return tooltip(LOOKS, properties.which)

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        return rpt("Apply a camouflage first") if coat_shown(context) is None else ""

    def work(self, context: bpy.types.Context) -> None:
        coat = require_coat(context)
        which = self.which
        if which == "TOGGLE":
            which = "CAMOUFLAGE" if coat.shown == "ORIGINAL" else "ORIGINAL"
        if which == "BAKED" and coat.image("baked") is None:
            raise contract.RaucaError("Nothing is baked yet; bake the camouflage first (step 7)")
        coat.show(which)


CLASSES = (RAUCA_OT_show_paint,)
