"""Step 7's settings and panel."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.app.translations import pgettext_iface as iface

from ...scene.coating import Coat
from ...translations import OWN_SENSE
from ..panel import State, StepPanel
from . import operators

SIZES = (512, 1024, 2048, 4096)


class RaucaBake(bpy.types.PropertyGroup):
    """Where the camouflage goes; ``baked_layer``, ``file`` and ``difference`` tell of the last bake."""

    layer: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="UV Layer",
        translation_context=OWN_SENSE,
        description="The UV layer to bake into; empty: the only one beside the camouflage's own",
    )
    size: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Size",
        items=[(str(size), f"{size} px", f"{size} x {size} texels") for size in SIZES],
        default="2048",
        description="Width and height of the image",
    )
    folder: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Folder", subtype="DIR_PATH", description="The image is written here, and kept inside the .blend as well"
    )
    allow_overlaps: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Allow Overlaps",
        description="Bake although parts share texels, such as mirrored sides: they get a mixture of both",
    )
    baked_layer: bpy.props.StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]
    file: bpy.props.StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]
    difference: bpy.props.FloatProperty(options={"HIDDEN"})  # type: ignore[valid-type]


def state(context: bpy.types.Context) -> State:
    """Quick: looks at the settings only."""
    settings, coat = context.scene.rauca.bake, context.scene.rauca.camouflage.coat
    if operators.running is not None:
        return State("running", iface("Baking; Esc stops it"))
    if coat is None:
        return State("missing", iface("Apply a camouflage first"))
    if not settings.folder:
        return State("missing", iface("Choose a folder for the image"))
    if Coat(coat).image("baked") is not None and settings.file:
        text = iface("Baked to {file}: colors differ by {share:.1%} on average")
        return State("done", text.format(file=Path(settings.file).name, share=settings.difference))
    return State("ready", iface("Ready to bake"))


class RAUCA_PT_bake(StepPanel, bpy.types.Panel):  # noqa: N801 - Blender wants this form
    """Bake the camouflage to other UVs"""

    bl_idname = "RAUCA_PT_bake"
    bl_label = "Bake"
    number = 7
    step_state = staticmethod(state)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings, camouflage = context.scene.rauca.bake, context.scene.rauca.camouflage
        run = operators.running
        if run is not None:
            layout.progress(factor=run.done, text=f"{run.done:.0%}")
            return
        row = layout.row(align=True)
        if camouflage.coat is not None and camouflage.anchor is not None and camouflage.anchor.type == "MESH":
            row.prop_search(settings, "layer", camouflage.anchor.data, "uv_layers", icon="GROUP_UVS")
        else:
            row.prop(settings, "layer")
        row.operator("rauca.new_uv_layer", text="", icon="ADD")
        layout.prop(settings, "size")
        layout.prop(settings, "folder")
        layout.prop(settings, "allow_overlaps")
        row = layout.row(align=True)
        row.operator("rauca.bake", icon="RENDER_STILL")
        if camouflage.coat is not None and Coat(camouflage.coat).image("baked") is not None:
            row.operator("rauca.export_glb", text="Export GLB", icon="EXPORT")
