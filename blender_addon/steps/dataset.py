"""Step 4: render every view in every weather, in other Blender processes, so that the window stays responsive."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_iface as iface
from bpy.app.translations import pgettext_rpt as rpt

from .. import compat
from ..core import contract
from ..folders import chosen_folder, job_folder, refuse_foreign
from ..jobs import pictures, watch
from ..jobs.background import Job, JobUpdate, Task
from ..jobs.child import child_command
from ..jobs.thumbnails import thumbnail
from .cameras import timing
from .job_panel import draw_buttons, draw_told, job_state, shown_job
from .on_disk import forget, frames_in
from .operator import BackgroundOperator, Obstacle, RaucaOperator
from .panel import SidebarPanel, State, StepPanel, folder_setting, paragraph

JOB = "dataset"
PICTURE = f"{JOB}.frame"


class RaucaDataset(bpy.types.PropertyGroup):
    """Settings of the dataset."""

    folder: folder_setting("Folder", "The dataset is written here and nowhere else")
    locations: bpy.props.IntProperty(
        name="Locations", default=1, min=1, max=100, description="Places in the town, each in another district"
    )
    size: bpy.props.IntProperty(
        name="Size", default=320, min=64, max=4096, subtype="PIXEL", description="Frames are square, this many wide"
    )
    samples: bpy.props.IntProperty(
        name="Samples", default=8, min=1, max=4096, description="Of the light per pixel: more are cleaner and slower"
    )
    denoise: bpy.props.BoolProperty(
        name="Denoise", default=True, description="Clean the frames up; without it take 64 samples or more"
    )
    light: bpy.props.BoolProperty(
        name="Light Maps",
        default=True,
        description="Keep how the light falls on the paint, so that any camouflage can be shown; step 5 needs it",
    )
    device: bpy.props.EnumProperty(
        name="Render On",
        items=[
            ("CPU", "CPU", "The same bytes on every run; slower"),
            ("GPU", "GPU", "The graphics cards that Cycles finds; refused where there is none"),
            ("AUTO", "GPU or CPU", "The graphics cards where there are any, else the CPU"),
        ],
        description="What Cycles renders the frames on; the dataset notes it",
    )
    part: bpy.props.IntProperty(
        name="Frames at Most",
        default=0,
        min=0,
        description="Render a part of so many frames, balanced over places, weathers and cameras; 0 renders all",
    )
    workers: bpy.props.IntProperty(
        name="Blenders",
        default=1,
        min=1,
        max=64,
        description="How many render at once: they share the machine, and each needs its memory",
    )
    seed: bpy.props.IntProperty(
        name="Seed", default=0, min=0, description="Another number gives other jitter and other noise"
    )
    retry: bpy.props.BoolProperty(
        name="Retry Failed", description="Try frames again that failed twice in an earlier run"
    )
    shown: bpy.props.IntProperty(name="Frame", default=1, min=1, description="The frame that is looked at")


def state(context: bpy.types.Context) -> State:
    settings = context.scene.rauca.dataset
    items, starting = iface("{done} of {total} frames"), iface("Building the scene in the background")
    if found := job_state(JOB, settings.folder, items, starting):
        return found
    if not settings.folder:
        return State("missing", iface("Choose a folder for the dataset"))
    if (there := frames_in(settings.folder)) and there.done:
        wanted = min(there.planned, settings.part or there.planned)
        words = iface("{done} of {total} frames are there").format(done=there.done, total=wanted)
        return State("done" if there.done >= wanted else "ready", words)
    count, time = timing.frame_count(context), contract.format_duration(timing.estimated_seconds(context))
    return State("ready", iface("Ready: {count} frames, about {time}").format(count=count, time=time))


class RAUCA_PT_dataset(StepPanel, bpy.types.Panel):
    """Render the dataset"""

    bl_label = "Generate Dataset"
    number = 4
    step_state = staticmethod(state)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings = context.scene.rauca.dataset
        column = layout.column()
        column.enabled = not watch.busy(JOB)
        for name in ("folder", "locations", "size", "samples", "denoise"):
            column.prop(settings, name)
        draw_buttons(layout, JOB, settings.folder, "rauca.generate_dataset", "RENDER_ANIMATION")
        if shown_job(JOB, settings.folder) and (icon := pictures.icon(PICTURE)):
            layout.template_icon(icon, scale=8)
        draw_told(context, layout, JOB, settings.folder)
        if not watch.busy(JOB) and settings.denoise and not compat.has_denoiser():
            count = samples_without_denoiser(settings.samples)
            words = iface("This Blender has no denoiser: {count} samples without it give as clean frames, more slowly")
            paragraph(context, layout, words.format(count=count), icon="ERROR")
            layout.operator("rauca.without_denoiser")


class RAUCA_PT_dataset_more(SidebarPanel, bpy.types.Panel):
    """Settings that are seldom changed"""

    bl_parent_id = "RAUCA_PT_dataset"
    bl_label = "More"

    def draw_inside(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        layout.enabled = not watch.busy(JOB)
        for name in ("light", "device", "part", "workers", "seed", "retry"):
            layout.prop(context.scene.rauca.dataset, name)


def samples_without_denoiser(samples: int) -> int:
    """Samples that give as clean frames as ``samples`` with denoising: eight times as many, in clear weather by day."""
    return min(max(8 * samples, 64), 1024)


class RAUCA_OT_without_denoiser(RaucaOperator, bpy.types.Operator):
    """Turn denoising off and take so many samples that the frames are as clean; they take longer"""

    bl_label = "Render Without Denoising"
    obstacles = (Obstacle("Denoise is off already", lambda context: not context.scene.rauca.dataset.denoise),)

    def work(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca.dataset
        settings.denoise, settings.samples = False, samples_without_denoiser(settings.samples)


class DatasetTask(Task):
    """Renders what ``folder`` lacks."""

    def hear(self, line: str) -> JobUpdate | None:
        if line.startswith("note: "):
            return JobUpdate(note=line.removeprefix("note: "))
        told = super().hear(line)
        if told is None or not told.doing:  # the newest frame's name
            return told
        picture = thumbnail(self.folder / "frames" / told.doing / "image.png")
        return told if picture is None else replace(told, pictures={"frame": picture})


class RAUCA_OT_generate_dataset(BackgroundOperator, bpy.types.Operator):
    """Render every view in every weather to the chosen folder; goes on where an earlier run stopped"""

    bl_label = "Generate Dataset"
    job = JOB
    running = "A dataset is being rendered; stop it first"
    obstacles = (Obstacle("Choose a folder for the dataset", lambda context: not context.scene.rauca.dataset.folder),)

    def begin(self, context: bpy.types.Context) -> None:
        settings = context.scene.rauca.dataset
        folder = chosen_folder(settings.folder, rpt("the dataset"))
        refuse_foreign(folder, "dataset.json", rpt("dataset"))
        if settings.denoise and not compat.has_denoiser():
            raise contract.RaucaError(
                rpt(
                    "This Blender was built without a denoiser; turn Denoise off and take {count} samples, or use "
                    "Blender from blender.org"
                ).format(count=samples_without_denoiser(settings.samples))
            )
        vehicle = context.scene.rauca.vehicle.chosen(context)
        scratch = job_folder()
        vehicle.save(scratch / "vehicle")
        contract.save_job(scratch / "job.json", dataset_job(context, folder, scratch / "vehicle"))
        task = DatasetTask(folder, child_command(scratch / "job.json"), scratch)
        workers = settings.workers

        def learn_pace(job: Job) -> None:
            forget()
            with contextlib.suppress(contract.RaucaError):  # one that ended without frames teaches nothing
                timing.learn(folder, workers)

        watch.begin(JOB, task, learn_pace)


def dataset_job(context: bpy.types.Context, out: Path, vehicle: Path) -> contract.MakeDataset:
    """What the panels of steps 1 to 4 ask for.

    Args:
        out: folder of the dataset.
        vehicle: folder of the saved vehicle.

    Raises:
        RaucaError: the list of weathers cannot be read, or the settings ask for what no dataset can be.
    """
    steps = context.scene.rauca
    settings = steps.dataset
    weathers, notes = steps.weather.chosen()
    plan = contract.Plan(
        name=out.name,
        vehicle_name="",
        atlas_id="",
        size=settings.size,
        quality=contract.Quality(settings.samples, denoise=settings.denoise),
        light=settings.light,
        weathers=tuple(weathers),
        ring=steps.cameras.ring(),
        locations=settings.locations,
        reference_srgb=contract.REFERENCE_SRGB,
        min_visible=contract.MIN_VISIBLE,
        seed=settings.seed,
        blender="",
    )
    plan.check(rpt("Generate Dataset"))
    return contract.MakeDataset(
        out=out,
        plan=plan,
        vehicle=contract.VehicleSource(str(vehicle)),
        frames=tuple(contract.balanced_frames(plan, settings.part)) if settings.part else None,
        workers=settings.workers,
        retry_quarantined=settings.retry,
        device=settings.device.lower(),
        notes=tuple(notes),
    )
