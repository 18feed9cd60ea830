"""Step 5: optimize a camouflage on the dataset, in an external Python beside the window."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import bpy
import numpy as np
from bpy.app.translations import pgettext_iface as iface
from bpy.app.translations import pgettext_rpt as rpt
from numpy.typing import NDArray

from ..core import contract, schema
from ..folders import chosen_folder, refuse_foreign
from ..jobs import pictures, watch
from ..jobs.background import Job, JobUpdate, Task
from ..jobs.thumbnails import thumbnail
from ..preferences import asks_for_python, draw_detectors, draw_python, lacks_python, preferences
from . import cost
from .dataset import JOB as DATASET_JOB
from .job_panel import draw_buttons, draw_told, job_state, shown_job
from .on_disk import CHECKPOINT, UNFINISHED, chosen_path, forget, frames_in, paint_in
from .operator import BackgroundOperator, RaucaOperator
from .panel import SidebarPanel, State, StepPanel, folder_setting

JOB = "optimize"


class RaucaOptimize(bpy.types.PropertyGroup):
    """Settings of the optimization."""

    dataset: folder_setting("Dataset", "Folder of the dataset; step 4's if left empty")
    folder: folder_setting("Folder", "The camouflage is written here and nowhere else")
    title: bpy.props.StringProperty(
        name="Name", default="rauca", description="The camouflage's name, in tables and pictures"
    )
    steps: bpy.props.IntProperty(
        name="Steps", default=1000, min=1, description="More bring the camouflage nearer to its best"
    )
    batch: bpy.props.IntProperty(
        name="Frames a Step", default=4, min=1, max=1024, description="More make a step surer and slower"
    )
    map_size: bpy.props.IntProperty(
        name="Texture Size", default=512, min=16, max=8192, subtype="PIXEL", description="Side of the camouflage"
    )
    seed: bpy.props.IntProperty(
        name="Seed", default=0, min=0, description="Another number begins with another random camouflage"
    )

    def dataset_folder(self, context: bpy.types.Context) -> str:
        """The dataset to optimize on: the one chosen here, or step 4's; empty without either."""
        return str(self.dataset or context.scene.rauca.dataset.folder)


def state(context: bpy.types.Context) -> State:
    settings = context.scene.rauca.optimize
    items, starting = iface("{done} of {total} steps"), iface("Reading the dataset and the detectors")
    if found := job_state(JOB, settings.folder, items, starting):
        return found
    there = paint_in(settings.folder)
    if there is not None and there.name and there.steps >= settings.steps:
        words = iface("{name} is there, after {done} steps")
        return State("done", words.format(name=there.name, done=there.steps))
    if lack := missing(context):
        return State("missing", lack)
    if there is not None:
        words = iface("Stands after {done} of {total} steps; Optimize goes on")
        return State("ready", words.format(done=there.steps, total=settings.steps))
    words = iface("Ready to optimize: about {time}, {disk} on the disk")
    return State("ready", words.format(**estimate(context).told()))


def estimate(context: bpy.types.Context) -> cost.Cost:
    """What the optimization will take; of a dataset that cannot be read yet, as step 4 describes it."""
    settings, settled, dataset = context.scene.rauca.optimize, preferences(context), context.scene.rauca.dataset
    there = frames_in(settings.dataset_folder(context))
    views = there.views if there is not None else len(context.scene.rauca.cameras.ring()) * dataset.locations
    size = there.size if there is not None else dataset.size
    names = settled.chosen_detectors() if settled is not None else []
    return cost.of_optimization(settings.steps, settings.batch, names, views, size, settings.map_size)


def missing(context: bpy.types.Context) -> str:
    """What to do before a camouflage can be optimized; empty when all is there."""
    settings = context.scene.rauca.optimize
    if lack := lacks_python(context):
        return lack
    if not settings.dataset_folder(context):
        return iface("Generate a dataset, or choose one")
    return "" if settings.folder else iface("Choose a folder for the camouflage")


class RAUCA_PT_optimize(StepPanel, bpy.types.Panel):
    """Optimize a camouflage"""

    bl_label = "Optimize"
    number = 5
    step_state = staticmethod(state)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        folder = context.scene.rauca.optimize.folder
        if asks_for_python(context, JOB):
            draw_python(context, layout)
        else:
            self._draw_settings(context, layout)
            draw_buttons(layout, JOB, folder, "rauca.optimize", "PLAY")
            layout.operator("rauca.use_now", icon="FORWARD")
        if found := shown_job(JOB, folder):
            self._draw_pictures(layout, found)
        draw_told(context, layout, JOB, folder)

    def _draw_settings(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings = context.scene.rauca.optimize
        every = layout.column()
        every.enabled = not watch.busy(JOB)
        column = every.column()
        column.prop(settings, "dataset", placeholder=context.scene.rauca.dataset.folder)
        for name in ("folder", "title", "steps"):
            column.prop(settings, name)
        draw_detectors(context, every)

    def _draw_pictures(self, layout: bpy.types.UILayout, found: Job) -> None:
        """The painted vehicle beside the camouflage, and below them how the loss went, with its figures."""
        row = layout.row()
        for kind in ("painted", "uv_map"):
            if icon := pictures.icon(f"{JOB}.{kind}"):
                row.template_icon(icon, scale=6)
        if icon := pictures.icon(f"{JOB}.loss"):
            halves = layout.split(factor=0.5)
            halves.template_icon(icon, scale=6)
            figures = halves.column(align=True)
            figures.separator(factor=4)
            for name, words in (("loss", iface("Loss {value:.3f}")), ("score", iface("Still seen {value:.0%}"))):
                figures.label(text=words.format(value=found.history[name][-1]), translate=False)


class RAUCA_PT_optimize_more(SidebarPanel, bpy.types.Panel):
    """Settings that are seldom changed"""

    bl_parent_id = "RAUCA_PT_optimize"
    bl_label = "More"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return not asks_for_python(context, JOB)

    def draw_inside(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        layout.enabled = not watch.busy(JOB)
        for name in ("batch", "map_size", "seed"):
            layout.prop(context.scene.rauca.optimize, name)
        draw_python(context, layout)


class RAUCA_OT_optimize(BackgroundOperator, bpy.types.Operator):
    """Optimize a camouflage on the dataset against the chosen detectors; goes on where an earlier run stopped"""

    bl_label = "Optimize"
    job = JOB
    running = "A camouflage is being optimized; stop it first"
    missing = staticmethod(missing)

    def begin(self, context: bpy.types.Context) -> None:
        settings, found = context.scene.rauca.optimize, preferences(context)
        assert found is not None  # poll
        dataset = Path(bpy.path.abspath(settings.dataset_folder(context))).absolute()
        _require_light(dataset)
        folder = chosen_folder(settings.folder, rpt("the camouflage"))
        if not begun(folder) and not (folder / HISTORY).is_file():
            refuse_foreign(folder, "camouflage.json", rpt("camouflage"))
        task = OptimizeTask(folder, _command(settings, found.program(), found.chosen_detectors(), dataset, folder))
        names, batch = found.chosen_detectors(), settings.batch

        def learn_and_offer(job: Job) -> None:
            with contextlib.suppress(contract.RaucaError, OSError):
                cost.learn(names, batch, task.seconds)
            _offer(job)

        watch.begin(JOB, task, learn_and_offer)


def _require_light(folder: Path) -> None:
    """Raise :class:`RaucaError` for a folder that cannot be optimized on."""
    making = watch.job(DATASET_JOB)
    if making is not None and making.alive and making.task.folder == folder:
        raise contract.RaucaError(rpt("The dataset is still being rendered; wait for it, or stop it"))
    if not contract.read_plan(folder).light:
        raise contract.RaucaError(
            rpt("{folder}: has no light maps; render it again with Light Maps on, in step 4").format(folder=folder)
        )


def _command(
    settings: bpy.types.PropertyGroup, python: Path, detectors: list[str], dataset: Path, folder: Path
) -> list[str]:
    # -P: a folder named pipelines where Blender was started must not stand in for rauca's.
    command = [str(python), "-P", "-m", "pipelines", "optimize", str(dataset), "--out", str(folder)]
    for name in detectors:
        command += ["--detector", name]
    command += ["--steps", str(settings.steps), "--batch", str(settings.batch), "--map-size", str(settings.map_size)]
    return [*command, "--seed", str(settings.seed), "--name", settings.title or "rauca", "--json-progress"]


class RAUCA_OT_use_now(RaucaOperator, bpy.types.Operator):
    """Put the camouflage as far as it is into step 6; an optimization at work goes on by itself afterwards"""

    bl_label = "Use Now"

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        found = watch.job(JOB)
        if found is not None and found.alive and found.phase != "paused":
            if found.phase != "running" or found.when_paused is not None:
                return rpt("Wait until a step is done")
            return ""
        folder = _folder(context)
        is_there = folder is not None and (folder / UNFINISHED).is_file()
        return "" if is_there else rpt("No optimization has been stopped or is at work")

    def work(self, context: bpy.types.Context) -> None:
        found = watch.job(JOB)
        if found is not None and found.phase == "running":
            found.when_paused = _use_and_go_on
            found.pause()
            return
        folder = _folder(context)
        assert folder is not None  # poll
        context.scene.rauca.camouflage.file = str(folder / UNFINISHED)


def _folder(context: bpy.types.Context) -> Path | None:
    """Of the paused job, else the one that is chosen."""
    found, setting = watch.job(JOB), context.scene.rauca.optimize.folder
    if found is not None and found.alive:
        return found.task.folder
    return chosen_path(setting) if setting else None


def _use_and_go_on(job: Job) -> None:
    _choose(job.task.folder / UNFINISHED)
    job.go_on()


def _offer(job: Job) -> None:
    """Put the finished camouflage into step 6 of the file that it was made for, unless another one is chosen there."""
    forget()
    scene = bpy.context.scene
    if job.phase != "done" or scene is None or shown_job(JOB, scene.rauca.optimize.folder) is None:
        return
    if scene.rauca.camouflage.file in ("", str(job.task.folder / UNFINISHED)):
        _choose(job.task.folder / "camouflage.json")


def _choose(camouflage: Path) -> None:
    """Choose a camouflage in step 6, as a step of undo: what the user did before can be undone without losing it."""
    bpy.context.scene.rauca.camouflage.file = str(camouflage)
    if bpy.ops.ed.undo_push.poll():
        bpy.ops.ed.undo_push(message="Rauca: Camouflage Chosen")


HISTORY = "history.jsonl"
FIGURES = ("loss", "score")
MAX_HISTORY_BYTES = 2**28  # as `rauca optimize` reads it


@dataclass
class OptimizeTask(Task):
    """Optimizes a camouflage into ``folder``, going on where an earlier run stopped."""

    seconds: list[float] = field(default_factory=list)  # of each step, in this session
    _told_history: bool = False
    _preview_at: int = 0  # when the pictures that were read last were written, nanoseconds

    def hear(self, line: str) -> JobUpdate | None:
        progress = contract.parse_optimize_progress(line)
        if progress is None:
            return None
        self.seconds.append(progress.seconds)
        figures: list[Mapping[str, float]] = [] if self._told_history else earlier(self.folder, progress.step)
        self._told_history = True
        figures.append({name: getattr(progress, name) for name in FIGURES})
        pictures = self._renewed(Path(progress.preview))
        return JobUpdate(progress.step, progress.of, progress.left_s, figures=figures, pictures=pictures)

    def _renewed(self, preview: Path) -> dict[str, NDArray[np.uint8]]:
        """The pictures, if their file was replaced since they were last read: the UV map and a painted frame."""
        try:
            changed = preview.stat().st_mtime_ns
        except OSError:
            return {}
        if self._preview_at == changed or (both := thumbnail(preview)) is None:
            return {}
        self._preview_at = changed
        half = both.shape[1] // 2
        return {"uv_map": both[:, :half], "painted": both[:, half:]}


def begun(folder: Path) -> bool:
    """Whether ``folder`` holds a run that can go on."""
    return (folder / CHECKPOINT).is_file()


def earlier(folder: Path, step: int) -> list[Mapping[str, float]]:
    """The figures of the steps before ``step``, as an earlier run left them."""
    try:
        told = schema.whole_lines(folder / HISTORY, MAX_HISTORY_BYTES, "a history of steps", _figures)
    except contract.RaucaError:
        return []
    return [figures for at, figures in told if at < step]


def _figures(line: schema.Fields) -> tuple[int, Mapping[str, float]]:
    return line.integer("step"), {name: line.number(name) for name in FIGURES}
