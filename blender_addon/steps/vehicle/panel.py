"""Where the choice of a vehicle stands."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import bpy
from bpy.app.translations import pgettext_iface as iface

from ...translations import OWN_SENSE
from ..panel import Kind, SidebarPanel, State, StepPanel, choice, paragraph
from .unwrap import RAUCA_OT_unwrap_paint


def state(context: bpy.types.Context) -> State:
    settings = context.scene.rauca.vehicle
    if RAUCA_OT_unwrap_paint.running():
        return State("running", iface("The paint is being unwrapped"))
    if settings.origin == "FILE":
        if not settings.file:
            return State("missing", iface("Choose a vehicle's file"))
        return State("done", iface("{name}, from its file").format(name=Path(settings.file).name))
    if settings.origin == "COLLECTION":
        picked, hint = settings.collection, iface("Choose the collection of the vehicle's parts")
    else:
        picked, hint = settings.object, iface("Pick an object, or add one of the vehicles above")
    if picked is None:
        return State("missing", hint)
    if settings.origin == "OBJECT" and picked.name not in context.scene.objects:
        return State("missing", iface("{name} is no longer in this scene; pick another").format(name=picked.name))
    faults = settings.missing + settings.outside + settings.overlapping + settings.uneven if settings.checked else 0
    if faults:
        words = iface("{name}: {count} triangles are faulty; unwrap the paint, under UV Map")
        return State("missing", words.format(name=picked.name, count=faults))
    # A shipped vehicle is known to be whole; of another one nobody knows before it was checked.
    kind: Kind = "done" if settings.checked or settings.is_shipped(context) else "ready"
    if settings.paint == "FACES":
        if not settings.marked:
            return State("missing", iface("Select faces of {name} in edit mode and mark them").format(name=picked.name))
        return State(kind, iface("{name}, {count} faces are paint").format(name=picked.name, count=settings.marked))
    if not settings.knows_paint(context):
        words = iface("Which material of {name} is paint? Choose it under Paint")
        return State("missing", words.format(name=picked.name))
    return State(kind, iface("{name} is the vehicle").format(name=picked.name))


class RAUCA_PT_vehicle(StepPanel, bpy.types.Panel):
    """Choose the vehicle, or add one"""

    bl_label = "Vehicle"
    bl_options: ClassVar[set[str]] = set()
    number = 1
    step_state = staticmethod(state)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings = context.scene.rauca.vehicle
        choice(layout, settings, "origin")
        layout.prop(settings, settings.origin.lower())
        if settings.origin != "FILE":
            layout.prop(settings, "front")
        layout.menu("RAUCA_MT_vehicles", icon="AUTO")
        layout.operator("rauca.demo_scene", icon="SCENE_DATA")


class RAUCA_PT_vehicle_paint(SidebarPanel, bpy.types.Panel):
    """Say which faces may be camouflaged"""

    bl_parent_id = "RAUCA_PT_vehicle"
    bl_label = "Paint"
    bl_translation_context = OWN_SENSE

    def draw_inside(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings = context.scene.rauca.vehicle
        if settings.origin == "FILE":
            layout.prop(settings, "file_material")
            layout.prop(settings, "file_mask")
            return
        choice(layout, settings, "paint")
        layout.prop(settings, "tint")
        if settings.paint == "MATERIAL":
            layout.prop(settings, "material")
            return
        row = layout.row(align=True)
        for action in ("ASSIGN", "REMOVE", "SELECT"):
            row.operator("rauca.mark_paint", text=action.capitalize()).action = action
        if context.mode != "EDIT_MESH":
            paragraph(context, layout, iface("Press Tab on the vehicle and select faces first"), "INFO")


class RAUCA_PT_vehicle_uvs(SidebarPanel, bpy.types.Panel):
    """Give the paint a UV map of its own, and check it"""

    bl_parent_id = "RAUCA_PT_vehicle"
    bl_label = "UV Map"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(context.scene.rauca.vehicle.origin != "FILE")

    def draw_inside(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings = context.scene.rauca.vehicle
        if RAUCA_OT_unwrap_paint.running():
            layout.label(text="Unwrapping; Esc stops it", icon="TIME")
        row = layout.row(align=True)
        row.operator("rauca.unwrap_paint", icon="UV")
        row.operator("rauca.check_uvs", icon="CHECKMARK").kind = "ALL"
        if not settings.checked:
            return
        faults = {
            "missing": iface("Without UVs: {count}"),
            "outside": iface("Outside: {count}"),
            "overlapping": iface("Overlapping: {count}"),
            "uneven": iface("Uneven: {count}"),
        }
        found = {name: getattr(settings, name) for name in faults if getattr(settings, name)}
        for name, count in found.items():
            line = layout.split(factor=0.72)
            line.label(text=faults[name].format(count=count), icon="ERROR", translate=False)
            line.operator("rauca.check_uvs", text="Select").kind = name.upper()
        if not found:
            layout.label(text="No faults found", icon="CHECKMARK")
