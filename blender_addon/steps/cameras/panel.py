"""The cameras step's panel, and the one inside it: jitter."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface

from ...core import contract
from ...translations import OWN_SENSE
from ..panel import SidebarPanel, State, StepPanel, paragraph
from .properties import RaucaCameras, anchor
from .timing import estimated_seconds, frame_count, pace


def state(context: bpy.types.Context) -> State:
    """How many cameras there are."""
    views = len(context.scene.rauca.cameras.ring())
    return State("done", iface("{count} views of the vehicle").format(count=views))


class RAUCA_PT_cameras(StepPanel, bpy.types.Panel):  # noqa: N801 - Blender wants this form
    """Place the cameras around the vehicle"""

    bl_idname = "RAUCA_PT_cameras"
    bl_label = "Cameras"
    number = 3
    step_state = staticmethod(state)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings = context.scene.rauca.cameras
        layout.prop(settings, "overlay")
        if settings.overlay and not anchor(context).found:
            text = iface("Drawn around the world's middle: the vehicle is not in this scene.")
            paragraph(context, layout, text, icon="INFO")
        layout.prop(settings, "azimuths")
        _draw_spread(settings, layout, "elevations", "elevation_low", "elevation_high")
        _draw_spread(settings, layout, "distances", "distance_near", "distance_far")
        layout.prop(settings, "fov")
        _draw_look(settings, layout)
        _draw_estimate(context, layout)


class RAUCA_PT_cameras_jitter(SidebarPanel, bpy.types.Panel):  # noqa: N801 - Blender wants this form
    """Let cameras stray from their places at random, each in its own way"""

    bl_idname = "RAUCA_PT_cameras_jitter"
    bl_label = "Jitter"
    bl_translation_context = OWN_SENSE
    bl_parent_id = "RAUCA_PT_cameras"

    def draw_inside(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        column = layout.column(align=True)
        for name in ("azimuth", "elevation", "distance", "aim", "roll"):
            column.prop(context.scene.rauca.cameras, f"jitter_{name}")


def _draw_spread(settings: RaucaCameras, layout: bpy.types.UILayout, count: str, low: str, high: str) -> None:
    """A count and its two ends; of one ring only the middle counts."""
    column = layout.column(align=True)
    column.prop(settings, count)
    column.prop(settings, low)
    column.prop(settings, high)


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
