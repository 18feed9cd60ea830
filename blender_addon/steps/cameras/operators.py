"""What the buttons of step 3 do."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ...scene.camera import leave, look
from ..operator import RaucaOperator


class RAUCA_OT_look_through(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """See what this view's camera will see, jitter included; your own camera is kept"""

    bl_idname = "rauca.look_through"
    bl_label = "Look Through"

    step: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Step", default=0, options={"SKIP_SAVE"}, description="Views to go on by; 0: the chosen one"
    )

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        tip = bpy.app.translations.pgettext_tip
        if properties.step < 0:
            return tip("Look through the view before; before the first comes the last")
        if properties.step > 0:
            return tip("Look through the next view; after the last comes the first")
        return tip(str(cls.__doc__))

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        if context.scene.library is not None:
            return rpt("This scene is linked from another file: open that file")
        return ""

    def work(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca.cameras
        settings.view = (settings.chosen() + self.step) % len(settings.ring(context)) + 1
        look(context.scene, settings, settings.viewpoint(context).camera)
        if context.space_data is not None and context.space_data.type == "VIEW_3D":
            context.space_data.region_3d.view_perspective = "CAMERA"


class RAUCA_OT_leave_view(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Bring back your own camera and picture size; the view's camera goes"""

    bl_idname = "rauca.leave_view"
    bl_label = "Leave View"

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        return rpt("No view is being looked through") if context.scene.rauca.cameras.camera is None else ""

    def work(self, context: bpy.types.Context) -> None:
        leave(context.scene, context.scene.rauca.cameras)
        space = context.space_data
        if space is not None and space.type == "VIEW_3D" and space.region_3d.view_perspective == "CAMERA":
            space.region_3d.view_perspective = "PERSP"


CLASSES = (
    RAUCA_OT_look_through,
    RAUCA_OT_leave_view,
)
