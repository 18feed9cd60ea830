"""Step 4: render every view in every weather."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface

from .panel import StepPanel, paragraph
from .state import State


class RaucaDataset(bpy.types.PropertyGroup):
    """Settings of the data set; ``job`` and ``done`` show the work in progress."""

    locations: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Locations", default=1, min=1, max=100, description="Places in the town, each in another district"
    )
    size: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Size", default=320, min=64, max=4096, description="Frames are square, this many pixels wide"
    )
    samples: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Samples", default=8, min=1, max=4096, description="Cycles samples per pixel, before denoising"
    )
    denoise: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Denoise", default=True, description="Use Open Image Denoise; without it take 64 samples or more"
    )
    folder: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Folder", subtype="DIR_PATH", description="The data set is written here and nowhere else"
    )
    job: bpy.props.StringProperty(options={"SKIP_SAVE"})  # type: ignore[valid-type]
    done: bpy.props.FloatProperty(options={"SKIP_SAVE"}, min=0.0, max=1.0)  # type: ignore[valid-type]


def state(context: bpy.types.Context) -> State:
    settings = context.scene.rauca.dataset
    if settings.job:
        return State("running", settings.job)
    if not settings.folder:
        return State("missing", iface("Choose a folder for the data set"))
    return State("ready", iface("Ready to render"))


class RAUCA_PT_dataset(StepPanel, bpy.types.Panel):  # noqa: N801 - Blender wants this form
    """Render the data set"""

    bl_idname = "RAUCA_PT_dataset"
    bl_label = "Generate dataset"
    number = 4
    step_state = staticmethod(state)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings = context.scene.rauca.dataset
        for name in ("locations", "size", "samples", "denoise", "folder"):
            layout.prop(settings, name)
        if settings.job:
            layout.progress(factor=settings.done, text=settings.job)
            paragraph(context, layout, iface("Press Esc to stop; finished frames are kept"))
        else:
            layout.operator("rauca.generate_dataset", icon="RENDER_ANIMATION")


CLASSES = (RaucaDataset, RAUCA_PT_dataset)
