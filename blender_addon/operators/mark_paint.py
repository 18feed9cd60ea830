"""Mark faces as paint by hand."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ..core import contract
from ..scene.mesh_edits import (
    mark_faces,
    marked_faces,
    object_mode,
    require_writable,
    select_faces,
    selected_faces,
)
from .operator import RaucaOperator, tooltip

ACTIONS = [
    ("ASSIGN", "Assign", "The selected faces are paint"),
    ("REMOVE", "Remove", "The selected faces are not paint"),
    ("SELECT", "Select", "Select the faces that are paint"),
]


class RAUCA_OT_mark_paint(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Say by the selected faces what is paint"""

    bl_idname = "rauca.mark_paint"
    bl_label = "Mark Paint"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute
    action: bpy.props.EnumProperty(name="Action", items=ACTIONS)  # type: ignore[valid-type]

    @classmethod
    def description(cls, context: bpy.types.Context, properties: RAUCA_OT_mark_paint) -> str:
        return tooltip(ACTIONS, properties.action)

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        if context.mode != "EDIT_MESH":
            return rpt("Select the vehicle and press Tab: faces are selected in edit mode")
        return ""

    def work(self, context: bpy.types.Context) -> str:
        settings = context.scene.rauca.vehicle
        parts = settings.required_objects(context)
        edited = [thing for thing in context.objects_in_mode_unique_data if thing in parts]
        if not edited:
            raise contract.RaucaError("The object in edit mode is no part of the vehicle; pick it in step 1, Vehicle")
        if self.action == "SELECT":
            return self._select(context, edited)
        for thing in edited:
            require_writable(thing)
        with object_mode(context):
            if not any(selected_faces(thing.data).any() for thing in edited):
                raise contract.RaucaError("No face is selected; select faces with 3 and a click or a box")
            for thing in edited:
                old, chosen = marked_faces(thing.data), selected_faces(thing.data)
                mark_faces(thing.data, old | chosen if self.action == "ASSIGN" else old & ~chosen)
            settings.paint = "FACES"
            settings.count_marked(context)
        return rpt("{count} faces are paint").format(count=settings.marked)

    @staticmethod
    def _select(context: bpy.types.Context, edited: list[bpy.types.Object]) -> str:
        bpy.ops.object.mode_set(mode="OBJECT")
        wanted = {thing: marked_faces(thing.data) for thing in edited}
        select_faces(context, wanted)
        return rpt("{count} faces selected").format(count=sum(int(faces.sum()) for faces in wanted.values()))


CLASSES = (RAUCA_OT_mark_paint,)
