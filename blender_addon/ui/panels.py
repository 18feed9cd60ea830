"""The sidebar tab "Rauca", in the order of the work."""

from __future__ import annotations

import bpy


class _RaucaPanel:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Rauca"


class RAUCA_PT_dataset(_RaucaPanel, bpy.types.Panel):  # noqa: N801 - Blender wants this form
    """Vehicle, weather, cameras, and the button that renders them."""

    bl_label = "Data set"
    bl_idname = "RAUCA_PT_dataset"

    def draw(self, context: bpy.types.Context) -> None:
        settings, layout = context.scene.rauca, self.layout
        layout.use_property_split = True
        for name in ("vehicle", "weathers", "locations", "azimuths", "size", "samples", "denoise", "folder"):
            layout.prop(settings, name)
        if settings.job:
            layout.progress(factor=settings.done, text=settings.job)
            layout.label(text="Press Esc to stop; finished frames are kept")
        else:
            layout.operator("rauca.generate_dataset", icon="RENDER_ANIMATION")


class RAUCA_PT_camouflage(_RaucaPanel, bpy.types.Panel):  # noqa: N801 - Blender wants this form
    """Put a camouflage on the vehicle."""

    bl_label = "Camouflage"
    bl_idname = "RAUCA_PT_camouflage"

    def draw(self, context: bpy.types.Context) -> None:
        settings, layout = context.scene.rauca, self.layout
        layout.use_property_split = True
        layout.prop(settings, "camouflage")
        layout.operator("rauca.apply_camouflage", icon="TEXTURE")
