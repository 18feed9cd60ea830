"""A job in a panel: how far it is, how it ended, and the buttons that pause, go on and stop."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface

from ..core import contract
from ..jobs import watch
from ..jobs.background import Job
from .on_disk import chosen_path, folder_there
from .operator import NO_UNDO, RaucaOperator
from .panel import State, paragraph

NOTES = 3  # the latest, so that a talkative job does not push the buttons away


def shown_job(name: str, folder: str) -> Job | None:
    """The job that a panel tells of: one at work, whichever file began it, or one that ended in this file's folder.

    Args:
        folder: the setting of this file.
    """
    found = watch.job(name)
    if found is None or found.alive or _is_here(found, folder):
        return found
    return None


def _is_here(found: Job, folder: str) -> bool:
    return bool(folder) and found.task.folder == chosen_path(folder)


def job_state(name: str, folder: str, items: str, starting: str) -> State | None:
    """The state of a step whose job is at work or done; None when the step's settings and the disk decide.

    Args:
        folder: the setting of this file.
        items: with ``{done}`` and ``{total}``, such as "{done} of {total} frames"; translated already, as is
        starting: what is going on before the first item.
    """
    found = shown_job(name, folder)
    if found is None or found.phase in ("stopped", "failed"):
        return None
    how_far = items.format(done=found.done, total=found.total) if found.total else starting
    if found.left_s is not None:
        how_far += iface(", about {time} left").format(time=contract.format_duration(found.left_s))
    words = {
        "done": iface("Finished: {how_far}"),
        "paused": iface("Paused: {how_far}"),
        "pausing": iface("Pausing as soon as what is in hand is finished"),
        "stopping": iface("Stopping as soon as what is in hand is finished"),
    }
    told = words.get(found.phase, "{how_far}").format(how_far=how_far)
    return State("done" if found.phase == "done" else "running", told)


def draw_buttons(layout: bpy.types.UILayout, name: str, folder: str, start: str, icon: str) -> None:
    """What begins a job or, in its place, how far it is; what steers it; its folder. Each has one place at all times.

    Args:
        folder: the setting of this file.
        start: the operator that begins the job.
    """
    found = shown_job(name, folder)
    at_work = found if found is not None and found.alive else None
    if at_work is None:
        layout.operator(start, icon=icon)
    else:
        layout.progress(factor=at_work.fraction, text=f"{at_work.fraction:.0%}")
    _draw_steering(layout, name, at_work)
    where = found.task.folder if found is not None else chosen_path(folder)
    row = layout.row()
    row.enabled = found is not None or folder_there(folder)
    draw_open_folder(row, str(where))


def draw_told(context: bpy.types.Context, layout: bpy.types.UILayout, name: str, folder: str) -> None:
    """What a job at work has to say, or how the last one in this file's ``folder`` ended; below all buttons."""
    found = shown_job(name, folder)
    if found is None:
        return
    if found.alive and not _is_here(found, folder):
        words = iface("Begun in another file; its results go to {folder}")
        paragraph(context, layout, words.format(folder=found.task.folder), icon="INFO")
    if not found.alive and found.phase != "done":
        paragraph(context, layout, found.ending, icon="ERROR" if found.phase == "failed" else "INFO")
    for note in found.notes[-NOTES:]:
        paragraph(context, layout, note, icon="INFO")


def draw_open_folder(layout: bpy.types.UILayout, folder: str) -> None:
    """A button that shows a folder in the system's own window."""
    layout.operator("wm.path_open", text="Open Folder", icon="FILE_FOLDER").filepath = folder


def draw_button(layout: bpy.types.UILayout, name: str, action: str, text: str, icon: str = "NONE") -> None:
    """A button that steers a job."""
    button = layout.operator("rauca.steer_job", text=iface(text), icon=icon)
    button.job, button.action = name, action


def _draw_steering(layout: bpy.types.UILayout, name: str, found: Job | None) -> None:
    """Greyed while nothing is at work."""
    row, phase = layout.row(align=True), found.phase if found is not None else ""
    row.enabled = found is not None
    if phase == "paused":
        draw_button(row, name, "GO_ON", "Go On", "PLAY")
    else:
        pause = row.row(align=True)
        pause.enabled = phase in ("starting", "running")
        draw_button(pause, name, "PAUSE", "Pause", "PAUSE")
    draw_button(row, name, "STOP", "Stop at Once" if phase == "stopping" else "Stop", "CANCEL")


ACTIONS = [
    ("PAUSE", "Pause", "Finish what is in hand, then leave the machine alone until you go on; nothing is lost"),
    ("GO_ON", "Go On", "Go on where the job was paused, with the settings it was started with"),
    (
        "STOP",
        "Stop",
        "End the job; what is finished is kept. Press again to end it without waiting for what is in hand",
    ),
]


class RAUCA_OT_steer_job(RaucaOperator, bpy.types.Operator):
    """Pause a job, go on with it, or stop it"""

    bl_label = "Steer Job"
    bl_options = NO_UNDO

    job: bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})
    action: bpy.props.EnumProperty(name="Action", items=ACTIONS, options={"SKIP_SAVE"})

    def work(self, context: bpy.types.Context) -> None:
        job = watch.job(self.job)
        if job is None or not job.alive:
            raise contract.RaucaError("Nothing is running")
        if self.action == "GO_ON" and job.phase != "paused":
            raise contract.RaucaError("Nothing is paused")
        {"PAUSE": job.pause, "GO_ON": job.go_on, "STOP": job.stop}[self.action]()
        watch.redraw()
