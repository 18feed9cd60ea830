"""The panel inside step 7 that leads from a photograph to the camouflage in the photograph's own light."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface

from ...jobs import watch
from ..job_panel import draw_buttons, draw_told
from ..panel import SidebarPanel, State, paragraph
from .operators import JOB, is_fitted, missing, missing_to_wear


def state(context: bpy.types.Context) -> State:
    """Where the photograph stands."""
    settings = context.scene.rauca.photograph
    if watch.busy(JOB):
        return State("running", iface("Working on the photograph"))
    if lack := missing(context):
        return State("missing", lack)
    if not is_fitted(context):
        if settings.marks:
            return State("ready", iface("{count} points are marked; press Fit").format(count=len(settings.marks)))
        return State("ready", iface("Mark points, or pull the view into place; then press Fit"))
    if lack := missing_to_wear(context):
        return State("ready", lack)
    if settings.missed_px >= 0:
        words = iface("Fitted: the marks are missed by {missed:.1f} pixels on average")
        return State("done", words.format(missed=settings.missed_px))
    return State("done", iface("Fitted; press Fit again after a change"))


class RAUCA_PT_photograph(SidebarPanel, bpy.types.Panel):
    """See the camouflage on the vehicle in a photograph, in the photograph's own light"""

    bl_label = "Photograph"
    bl_parent_id = "RAUCA_PT_evaluate"

    def draw_inside(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings, space = context.scene.rauca.photograph, context.space_data
        every = layout.column()
        every.enabled = not watch.busy(JOB)
        for name in ("file", "mask", "folder", "fov"):
            every.prop(settings, name)
        row = every.row(align=True)
        row.operator("rauca.look_at_photograph", icon="IMAGE_BACKGROUND")
        row.operator("rauca.leave_photograph", text="", icon="X")
        if getattr(space, "type", "") == "VIEW_3D":  # Blender's own: the view's movements move the camera
            pulled = every.column()
            pulled.enabled = settings.camera is not None  # it would move the artist's own camera
            pulled.prop(space, "lock_camera", text=iface("Pull the View"))
        row = every.row(align=True)
        row.operator("rauca.mark_points", icon="EYEDROPPER")
        row.operator("rauca.remove_marks", text="", icon="LOOP_BACK").which = "LAST"
        row.operator("rauca.remove_marks", text="", icon="TRASH").which = "ALL"
        draw_buttons(layout, JOB, settings.folder, "rauca.fit_photograph", "CON_CAMERASOLVER")
        layout.operator("rauca.wear_photograph", icon="BRUSH_DATA")
        paragraph(context, layout, state(context).words)
        draw_told(context, layout, JOB, settings.folder)
