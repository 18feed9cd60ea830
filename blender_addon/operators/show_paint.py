"""Change between the original paint, the camouflage and the baked picture."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt
from bpy.app.translations import pgettext_tip as tip

from ..core import contract
from .on_vehicle import coat_shown
from .operator import RaucaOperator


class RAUCA_OT_show_paint(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Change between the original paint and the camouflage"""

    bl_idname = "rauca.show_paint"
    bl_label = "Original / Camouflage"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute
    which: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Show",
        items=[
            ("TOGGLE", "Toggle", "The original paint if the camouflage shows, else the camouflage"),
            ("ORIGINAL", "Original", "The vehicle's own paint"),
            ("CAMOUFLAGE", "Camouflage", "The camouflage, in the UV layer that it was made for"),
            ("BAKED", "Baked", "The baked image, in its own UV layer"),
        ],
        options={"SKIP_SAVE"},
    )

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        items = cls.bl_rna.properties["which"].enum_items if hasattr(cls, "bl_rna") else {}
        item = items.get(properties.which) if items else None
        return tip(item.description) if item is not None else ""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if coat_shown(context) is None:
            cls.poll_message_set(rpt("Apply a camouflage first"))
            return False
        return True

    def work(self, context: bpy.types.Context) -> None:
        coat = coat_shown(context)
        if coat is None:
            raise contract.RaucaError("No camouflage on the vehicle; apply one first (step 6)")
        which = self.which
        if which == "TOGGLE":
            which = "CAMOUFLAGE" if coat.shown == "ORIGINAL" else "ORIGINAL"
        if which == "BAKED" and coat.image("baked") is None:
            raise contract.RaucaError("Nothing is baked yet; bake the camouflage first (step 7)")
        coat.show(which)


CLASSES = (RAUCA_OT_show_paint,)
