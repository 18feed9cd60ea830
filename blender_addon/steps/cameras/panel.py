"""The cameras step's panel, the one inside it, jitter, and what their buttons do."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface
from bpy.app.translations import pgettext_tip as tip

from ...core import contract
from ...scene.camera import leave, look
from ...translations import OWN_SENSE
from ..operator import LINKED, Obstacle, RaucaOperator, covered, see_through_camera
from ..panel import SidebarPanel, State, StepPanel, paragraph
from .properties import RaucaCameras, anchor
from .timing import estimated_seconds, frame_count, pace


def state(context: bpy.types.Context) -> State:
    """How many cameras there are; done once something of them was set."""
    settings = context.scene.rauca.cameras
    words = iface("{count} views of the vehicle").format(count=len(settings.ring()))
    return State("done" if settings.used else "ready", words)


class RAUCA_PT_cameras(StepPanel, bpy.types.Panel):
    """Place the cameras around the vehicle"""

    bl_label = "Cameras"
    number = 3
    step_state = staticmethod(state)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings = context.scene.rauca.cameras
        layout.operator_menu_enum("rauca.camera_preset", "preset", icon="PRESET")
        layout.prop(settings, "overlay")
        layout.prop(settings, "azimuths")
        # A count and its two ends; of one ring only the middle counts.
        for names in (
            ("elevations", "elevation_low", "elevation_high"),
            ("distances", "distance_near", "distance_far"),
        ):
            column = layout.column(align=True)
            for name in names:
                column.prop(settings, name)
        layout.prop(settings, "fov")
        _draw_look(settings, layout)
        if settings.overlay and not anchor(context).found:
            text = iface("Drawn as soon as the vehicle is in this scene.")
            paragraph(context, layout, text, icon="INFO")
        _draw_estimate(context, layout)


class RAUCA_PT_cameras_jitter(SidebarPanel, bpy.types.Panel):
    """Let cameras stray from their places at random, each in its own way"""

    bl_label = "Jitter"
    bl_translation_context = OWN_SENSE
    bl_parent_id = "RAUCA_PT_cameras"

    def draw_inside(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        column = layout.column(align=True)
        for name in ("azimuth", "elevation", "distance", "aim", "roll"):
            column.prop(context.scene.rauca.cameras, f"jitter_{name}")


def _draw_look(settings: RaucaCameras, layout: bpy.types.UILayout) -> None:
    column = layout.column(align=True)
    row = column.row(align=True)
    row.use_property_split = False
    row.operator("rauca.look_through", text="", icon="TRIA_LEFT").step = -1
    row.prop(settings, "view")
    row.operator("rauca.look_through", text="", icon="TRIA_RIGHT").step = 1
    if settings.looking:
        column.operator("rauca.leave_view", icon="X")
    else:
        column.operator("rauca.look_through", icon="VIEW_CAMERA").step = 0


def _draw_estimate(context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
    column = layout.column(align=True)
    count, time = frame_count(context), contract.format_duration(estimated_seconds(context))
    paragraph(context, column, iface("{count} frames, about {time}").format(count=count, time=time), icon="TIME")
    known = pace()
    if known.frames:
        said = iface("Measured on {count} frames of this machine").format(count=known.frames)
    else:
        said = iface("A guess until a dataset has been rendered here")
    paragraph(context, column, said, icon="BLANK1")


class RAUCA_OT_look_through(RaucaOperator, bpy.types.Operator):
    """See what this view's camera will see, jitter included; your own camera is kept"""

    bl_label = "Look Through"
    obstacles = (LINKED, covered("cameras"))

    step: bpy.props.IntProperty(
        name="Step", default=0, options={"SKIP_SAVE"}, description="Views to go on by; 0: the chosen one"
    )

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        if properties.step < 0:
            return tip("Look through the view before; before the first comes the last")
        if properties.step > 0:
            return tip("Look through the next view; after the last comes the first")
        return ""

    def work(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca.cameras
        settings.view = (settings.chosen() + self.step) % len(settings.ring()) + 1
        look(context.scene, settings, settings.viewpoint(context).camera)
        see_through_camera(context, True)


class RAUCA_OT_leave_view(RaucaOperator, bpy.types.Operator):
    """Bring back your own view, camera and picture size; the view's camera goes"""

    bl_label = "Leave View"
    obstacles = (
        Obstacle("No view is being looked through", lambda context: context.scene.rauca.cameras.camera is None),
        covered("cameras"),
    )

    def work(self, context: bpy.types.Context) -> None:
        see_through_camera(context, False)  # while there is a camera to look through
        leave(context.scene, context.scene.rauca.cameras)
