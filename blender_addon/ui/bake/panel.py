"""The panel of step 7."""

from __future__ import annotations

import bpy

from ...operators import bake_camouflage
from ...scene.coating import Coat
from ..panel import StepPanel
from .state import state


class RAUCA_PT_bake(StepPanel, bpy.types.Panel):  # noqa: N801 - Blender wants this form
    """Bake the camouflage to other UVs"""

    bl_idname = "RAUCA_PT_bake"
    bl_label = "Bake"
    number = 7
    step_state = staticmethod(state)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings, camouflage = context.scene.rauca.bake, context.scene.rauca.camouflage
        run = bake_camouflage.running
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
