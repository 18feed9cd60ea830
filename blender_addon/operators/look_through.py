"""Look through a view of the dataset."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ..scene.camera import look
from .operator import RaucaOperator


class RAUCA_OT_look_through(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """See what this view's camera will see, jitter included; your own camera is kept"""

    bl_idname = "rauca.look_through"
    bl_label = "Look Through"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute

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


CLASSES = (RAUCA_OT_look_through,)
