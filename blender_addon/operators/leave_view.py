"""Back from a view of the dataset to the artist's own camera."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ..scene.camera import leave
from .operator import RaucaOperator


class RAUCA_OT_leave_view(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Bring back your own camera and picture size; the view's camera goes"""

    bl_idname = "rauca.leave_view"
    bl_label = "Leave View"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        return rpt("No view is being looked through") if context.scene.rauca.cameras.camera is None else ""

    def work(self, context: bpy.types.Context) -> None:
        leave(context.scene, context.scene.rauca.cameras)
        space = context.space_data
        if space is not None and space.type == "VIEW_3D" and space.region_3d.view_perspective == "CAMERA":
            space.region_3d.view_perspective = "PERSP"


CLASSES = (RAUCA_OT_leave_view,)
