"""Step 7: judge a camouflage, or detectors, on views that nobody trained on, in an external Python."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_iface as iface
from bpy.app.translations import pgettext_rpt as rpt

from .. import compat
from ..core import contract, files, schema
from ..folders import chosen_folder, job_folder, refuse_foreign
from ..jobs import watch
from ..jobs.background import Job, Task
from ..preferences import asks_for_python, draw_detectors, draw_python, lacks_python, preferences
from ..scene.vehicle import NAME_KEY
from . import cost
from .camouflage.evaluation import NORMAL, STUDY
from .camouflage.found import Found, read_found
from .camouflage.painted_vehicle import vehicle_for
from .job_panel import draw_buttons, draw_told, job_state, shown_job
from .on_disk import ask, camouflage_at, chosen_path, forget
from .operator import BackgroundOperator
from .panel import SidebarPanel, State, StepPanel, choice, folder_setting, paragraph

JOB = "evaluate"
MARK = "evaluated.json"  # in a folder that this step writes to: whether what it began there is finished
BATTERY_VEHICLES = ("sedan", "suv")  # that `rauca assess` looks at
BATTERY_PAINTS = 5  # the vehicle's own, random, and a library of three


@dataclass(frozen=True)
class Effort:
    """What an effort is called on the two command lines, and how much that is.

    ``frames`` are held-out views; the battery's ``views``, its ``lit_views`` for an attack and the attack's ``steps``
    are a vehicle's.
    """

    scale: str
    budget: str
    frames: int
    views: int
    lit_views: int
    steps: int


EFFORTS = {
    "QUICK": Effort("quick", "quick", 64, 14, 12, 120),
    "STANDARD": Effort("standard", "standard", 256, 128, 192, 1000),
    "THOROUGH": Effort("full", "overnight", 2048, 512, 384, 6000),
}


class RaucaEvaluate(bpy.types.PropertyGroup):
    """Settings of the evaluation."""

    judged: bpy.props.EnumProperty(
        name="Judge",
        items=[
            ("CAMOUFLAGE", "Camouflage", "How well detectors still find the vehicle in the camouflage of step 6"),
            ("DETECTORS", "Detectors", "How robust the detectors are, under a frozen set of views and camouflages"),
        ],
        description="What is judged",
    )
    folder: folder_setting("Folder", "The evaluation is written here and nowhere else, but for what all of them share")
    effort: bpy.props.EnumProperty(
        name="Effort",
        items=[
            ("QUICK", "Quick", "See that everything works, and roughly where things stand"),
            ("STANDARD", "Standard", "For numbers that will be quoted"),
            ("THOROUGH", "Thorough", "As much as there is; for a night, or several"),
        ],
        description="How many views, and how long an attack",
    )
    white_box: bpy.props.BoolProperty(
        name="Attack Each", default=True, description="Make a camouflage against each detector itself, too"
    )
    frames: bpy.props.IntProperty(
        name="Frames", min=0, description="Views in each of two sets of weathers; 0: as many as the effort says"
    )
    size: bpy.props.IntProperty(
        name="Size", default=320, min=64, max=4096, subtype="PIXEL", description="Frames are square, this many wide"
    )


def state(context: bpy.types.Context) -> State:
    settings = context.scene.rauca.evaluate
    job = watch.job(JOB)
    items = f"{doing_words(job.doing) if job is not None else ''}: {{done}} / {{total}}"
    found, told = job_state(JOB, settings.folder, items, iface("Looking at the detectors and the vehicle")), None
    if found is None or found.kind == "done":  # what was found says more than that it is finished
        told = found_in(settings.folder)
    if told:
        return State("done", _headline(told))
    if found is not None:
        return found
    if lack := missing(context):
        return State("missing", lack)
    return State("ready", iface("Ready: about {time}, {disk} on the disk").format(**estimate(context).told()))


def missing(context: bpy.types.Context) -> str:
    """What to do before anything can be judged; empty when all is there."""
    settings = context.scene.rauca.evaluate
    if lack := lacks_python(context):
        return lack
    if settings.judged == "CAMOUFLAGE" and camouflage_at(context.scene.rauca.camouflage.file) is None:
        return iface("Choose a camouflage in step 6")
    return "" if settings.folder else iface("Choose a folder for the evaluation")


def estimate(context: bpy.types.Context) -> cost.Cost:
    """What the evaluation will take."""
    settings, settled = context.scene.rauca.evaluate, preferences(context)
    names, effort = settled.chosen_detectors() if settled is not None else [], EFFORTS[settings.effort]
    if settings.judged == "CAMOUFLAGE":
        return cost.of_evaluation(2 * settings.frames or effort.frames, 2, names, settings.size)
    vehicles, attacked = len(_battery(context) or BATTERY_VEHICLES), settings.white_box
    return cost.of_evaluation(
        vehicles * effort.views, BATTERY_PAINTS + attacked, names, 320,
        vehicles * effort.steps * attacked, vehicles * effort.lit_views * attacked,
    )  # fmt: skip


def found_in(setting: str) -> list[Found] | None:
    """The results in the chosen folder; None where there are none that can be read."""
    return ask("found", setting, (MARK,), _finished)


def _finished(folder: Path) -> list[Found] | None:
    return read_found(folder) if schema.read_json(folder / MARK).raw("finished") is True else None


def doing_words(title: str) -> str:
    """What a study says that it does, in the user's language; what it does it for is left out."""
    said = {
        "rendering views": iface("Rendering views"),
        "re-rendering in camouflage": iface("Rendering them in camouflage"),
        "detecting": iface("Detecting"),
        "optimizing": iface("Attacking"),
        "drawing random paint": iface("Drawing random paint"),
        "comparing camouflages": iface("Comparing camouflages"),
    }
    return said.get(title.partition(",")[0], iface("Working"))


def _headline(told: list[Found]) -> str:
    first = told[0]
    if first.mean:
        others = [(paint, ap) for paint, ap in first.worn.items() if paint != NORMAL]
        paint, ap = others[0] if others else (NORMAL, first.worn[NORMAL])
        words = iface("Found {plain:.0%} in its own paint, {worn:.0%} in {paint}")
        return words.format(plain=first.worn[NORMAL], worn=ap, paint=paint)
    words = iface("{name}: {clean:.0%} in the vehicles' own paint, {transfer:.0%} in camouflages made for others")
    return words.format(name=first.by, **first.worn)


class RAUCA_PT_evaluate(StepPanel, bpy.types.Panel):
    """See how well detectors find the vehicle, on views that nobody trained on"""

    bl_label = "Evaluate"
    number = 7
    step_state = staticmethod(state)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings = context.scene.rauca.evaluate
        if asks_for_python(context, JOB):
            draw_python(context, layout)
        else:
            every = layout.column()
            every.enabled = not watch.busy(JOB)
            choice(every, settings, "judged")
            for name in ("folder", "effort"):
                every.prop(settings, name)
            draw_detectors(context, every)
            draw_buttons(layout, JOB, settings.folder, "rauca.evaluate", "VIEWZOOM")
        if told := found_in(settings.folder):
            _draw_table(context, layout, told)
        draw_told(context, layout, JOB, settings.folder)


def _draw_table(context: bpy.types.Context, layout: bpy.types.UILayout, told: list[Found]) -> None:
    """A line a detector: how well it finds the vehicle in each paint; the button that opens the whole page."""
    names = {
        "normal": iface("Own Paint"), "clean": iface("Own Paint"), "random": iface("Random"),
        "transfer": iface("Others'"), "white_box": iface("Against It"),
    }  # fmt: skip
    parts = {
        "took no part": iface("Detectors that took no part in the attack"),
        "family of an attacked one": iface("Relatives of an attacked one"),
        "attacked": iface("Detectors that were attacked"),
        "this project's own": iface("Detectors of this project"),
    }
    box = layout.box().column(align=True)
    for found in told:
        box.label(text=parts[found.by] if found.mean else found.by, translate=False)
        for paint, ap in found.worn.items():
            line = box.split(factor=0.75)
            line.label(text=names.get(paint, paint), icon="BLANK1", translate=False)
            line.label(text=f"{ap:.2f}", translate=False)
    paragraph(context, box, iface("Average precision: 1 is always found, 0 never"), "INFO")


class RAUCA_PT_evaluate_more(SidebarPanel, bpy.types.Panel):
    """Settings that are seldom changed"""

    bl_parent_id = "RAUCA_PT_evaluate"
    bl_label = "More"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return not asks_for_python(context, JOB)

    def draw_inside(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        layout.enabled = not watch.busy(JOB)
        settings = context.scene.rauca.evaluate
        for name in ("frames", "size") if settings.judged == "CAMOUFLAGE" else ("white_box",):
            layout.prop(settings, name)


class RAUCA_OT_evaluate(BackgroundOperator, bpy.types.Operator):
    """Render held-out views and show them to the chosen detectors; goes on where an earlier run stopped"""

    bl_label = "Evaluate"
    job = JOB
    running = "An evaluation is running; stop it first"
    missing = staticmethod(missing)

    def begin(self, context: bpy.types.Context) -> None:
        settings, found = context.scene.rauca.evaluate, preferences(context)
        assert found is not None  # poll
        folder = chosen_folder(settings.folder, rpt("the evaluation"))
        refuse_foreign(folder, MARK, rpt("evaluation"))
        scratch = job_folder()
        try:
            judging = _judging(context, folder, scratch)
            files.write_json(folder / MARK, {"finished": False})
            command = [str(found.program()), "-P", "-m", "pipelines", *judging, "--out", str(folder)]
            if bpy.app.binary_path and compat.has_denoiser():  # else the Python's own Blender, the bpy wheel
                command += ["--blender", bpy.app.binary_path]
            device = context.scene.rauca.dataset.device.lower()
            task = Task(folder, [*command, "--render-device", device, "--json-progress"], scratch)
            watch.begin(JOB, task, _show)
        except BaseException:
            shutil.rmtree(scratch, ignore_errors=True)
            raise


def _judging(context: bpy.types.Context, folder: Path, scratch: Path) -> list[str]:
    """The command's first words: what is judged, by whom, and how thoroughly."""
    settings, settled = context.scene.rauca.evaluate, preferences(context)
    assert settled is not None  # poll
    names, effort = settled.chosen_detectors(), EFFORTS[settings.effort]
    if settings.judged == "DETECTORS":
        attack = "--white-box" if settings.white_box else "--no-white-box"
        chosen = [word for name in _battery(context) for word in ("--vehicle", name)]
        return ["assess", *names, "--budget", effort.budget, attack, *chosen]
    path = chosen_path(context.scene.rauca.camouflage.file).with_suffix(".json")
    made = contract.load_camouflage(path)[0]
    vehicle = vehicle_for(context, path)
    made.check_fits(vehicle.atlas_id, str(path))
    vehicle.save(scratch / "vehicle")
    words = ["evaluate", str(path), "--vehicle", str(scratch / "vehicle"), "--detectors", ",".join(names)]
    words += ["--frames", str(settings.frames)] if settings.frames else ["--scale", effort.scale]
    return [*words, "--size", str(settings.size)]


def _battery(context: bpy.types.Context) -> list[str]:
    """The battery's vehicle that is the scene's; none: all of them are looked at."""
    chosen = context.scene.rauca.vehicle
    name = chosen.object[NAME_KEY] if chosen.is_shipped(context) else ""
    return [name] if name in BATTERY_VEHICLES else []


def _show(job: Job) -> None:
    """Choose a finished evaluation to look through in the file that it was made for, as a step of undo."""
    forget()
    scene = bpy.context.scene
    if job.phase != "done":
        return
    files.write_json(job.task.folder / MARK, {"finished": True})
    if scene is None or shown_job(JOB, scene.rauca.evaluate.folder) is None:
        return
    folder = job.task.folder  # of one assessment, or of the first of several
    study = min(folder.glob(f"*/{STUDY}"), default=folder / STUDY) if not (folder / STUDY).is_file() else folder / STUDY
    scene.rauca.camouflage.study = str(study.parent)
    if bpy.ops.ed.undo_push.poll():
        bpy.ops.ed.undo_push(message="Rauca: Evaluation Finished")
