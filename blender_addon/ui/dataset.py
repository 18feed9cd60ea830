"""Step 4: render every view in every weather."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface

from .. import compat
from ..background import pictures, watch
from ..jobs.pace import spoken
from ..operators.generate_dataset import JOB
from ..operators.without_denoiser import samples_without_denoiser
from .cameras import timing
from .job_view import draw_job, draw_open_folder, job_state
from .panel import SidebarPanel, StepPanel, paragraph
from .state import State

PICTURE = f"{JOB}.frame"


class RaucaDataset(bpy.types.PropertyGroup):
    """Settings of the dataset."""

    folder: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Folder",
        subtype="DIR_PATH",
        options=compat.path_options(),
        description="The dataset is written here and nowhere else",
    )
    locations: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Locations", default=1, min=1, max=100, description="Places in the town, each in another district"
    )
    size: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Size", default=320, min=64, max=4096, subtype="PIXEL", description="Frames are square, this many wide"
    )
    samples: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Samples", default=8, min=1, max=4096, description="Of the light per pixel: more are cleaner and slower"
    )
    denoise: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Denoise", default=True, description="Clean the frames up; without it take 64 samples or more"
    )
    light: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Light Maps",
        default=True,
        description="Keep how the light falls on the paint, so that any camouflage can be shown; step 5 needs it",
    )
    device: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Render On",
        items=[
            ("CPU", "CPU", "The same bytes on every run; slower"),
            ("GPU", "GPU", "The graphics cards that Cycles finds; refused where there is none"),
            ("AUTO", "GPU or CPU", "The graphics cards where there are any, else the CPU"),
        ],
        description="What Cycles renders the frames on; the dataset notes it",
    )
    part: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Frames at Most",
        default=0,
        min=0,
        description="Render a part of so many frames, balanced over places, weathers and cameras; 0 renders all",
    )
    workers: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Blenders",
        default=1,
        min=1,
        max=64,
        description="How many render at once: they share the machine, and each needs its memory",
    )
    seed: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Seed", default=0, min=0, description="Another number gives other jitter and other noise"
    )
    retry: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Retry Failed", description="Try frames again that failed twice in an earlier run"
    )


def state(context: bpy.types.Context) -> State:
    if found := job_state(JOB, iface("{done} of {total} frames"), iface("Building the scene in the background")):
        return found
    if not context.scene.rauca.dataset.folder:
        return State("missing", iface("Choose a folder for the dataset"))
    count, time = timing.frame_count(context), spoken(timing.estimated_seconds(context))
    return State("ready", iface("Ready: {count} frames, about {time}").format(count=count, time=time))


class RAUCA_PT_dataset(StepPanel, bpy.types.Panel):  # noqa: N801 - Blender wants this form
    """Render the dataset"""

    bl_idname = "RAUCA_PT_dataset"
    bl_label = "Generate Dataset"
    number = 4
    step_state = staticmethod(state)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        if not watch.busy(JOB):
            self._draw_settings(context, layout)
        draw_job(context, layout, JOB)
        if icon := pictures.icon(PICTURE):
            layout.template_icon(icon, scale=8)
        if found := watch.job(JOB):
            draw_open_folder(layout, str(found.task.folder))

    def _draw_settings(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings = context.scene.rauca.dataset
        column = layout.column()
        for name in ("folder", "locations", "size", "samples", "denoise"):
            column.prop(settings, name)
        if settings.denoise and not compat.denoiser_is_built_in():
            count = samples_without_denoiser(settings.samples)
            words = iface("This Blender has no denoiser: {count} samples without it give as clean frames, more slowly")
            paragraph(context, layout, words.format(count=count), icon="ERROR")
            layout.operator("rauca.without_denoiser")
        layout.operator("rauca.generate_dataset", icon="RENDER_ANIMATION")


class RAUCA_PT_dataset_more(SidebarPanel, bpy.types.Panel):  # noqa: N801 - Blender wants this form
    """Settings that are seldom changed"""

    bl_idname = "RAUCA_PT_dataset_more"
    bl_parent_id = "RAUCA_PT_dataset"
    bl_label = "More"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return not watch.busy(JOB)

    def draw_inside(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        for name in ("light", "device", "part", "workers", "seed", "retry"):
            layout.prop(context.scene.rauca.dataset, name)


CLASSES = (RaucaDataset, RAUCA_PT_dataset, RAUCA_PT_dataset_more)
