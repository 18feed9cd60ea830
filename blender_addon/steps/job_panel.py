"""A job in a panel: how far it is, how it ended, and the buttons that pause, go on and stop."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface

from ..core import contract
from ..jobs import watch
from ..jobs.background import Job
from .operator import NO_UNDO, RaucaOperator
from .panel import State, paragraph

NOTES = 3  # the latest, so that a talkative job does not push the buttons away


def job_state(name: str, items: str, starting: str) -> State | None:
    """The state of a step whose job is at work or done; None when the step's settings decide.

    Args:
        items: with ``{done}`` and ``{total}``, such as "{done} of {total} frames"; translated already, as is
        starting: what is going on before the first item.
    """
    found = watch.job(name)
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


def draw_job(context: bpy.types.Context, layout: bpy.types.UILayout, name: str) -> None:
    """Progress, notes and buttons of a job at work, or how the last one ended."""
    found = watch.job(name)
    if found is None:
        return
    if found.alive:
        layout.progress(factor=found.fraction, text=f"{found.fraction:.0%}")
        _draw_buttons(layout, name, found)
    elif found.phase != "done" and found.ending is not None:
        words = iface(found.ending.text).format(**found.ending.values)
        paragraph(context, layout, words, icon="ERROR" if found.phase == "failed" else "INFO")
    for note in found.notes[-NOTES:]:
        paragraph(context, layout, note, icon="INFO")


def draw_open_folder(layout: bpy.types.UILayout, folder: str) -> None:
    """A button that shows a folder in the system's own window."""
    layout.operator("wm.path_open", text="Open Folder", icon="FILE_FOLDER").filepath = folder


def _draw_buttons(layout: bpy.types.UILayout, name: str, found: Job) -> None:
    row = layout.row(align=True)
    if found.phase == "paused":
        row.operator("rauca.continue_job", icon="PLAY").job = name
    else:
        pause = row.row(align=True)
        pause.enabled = found.phase in ("starting", "running")
        pause.operator("rauca.pause_job", icon="PAUSE").job = name
    text = "Stop at Once" if found.phase == "stopping" else "Stop"
    row.operator("rauca.stop_job", text=text, icon="CANCEL").job = name


class _JobOperator(RaucaOperator):
    """Base of an operator on a job under way."""

    bl_options = NO_UNDO

    job: bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})

    def work(self, context: bpy.types.Context) -> None:
        self.steer(watch.job(self.job))
        watch.redraw()

    def steer(self, job: Job | None) -> None:
        """Do it; raises :class:`RaucaError` where ``job`` is not in the phase for it."""
        raise NotImplementedError


class RAUCA_OT_pause_job(_JobOperator, bpy.types.Operator):
    """Finish what is in hand, then leave the machine alone until you go on; nothing is lost"""

    bl_idname = "rauca.pause_job"
    bl_label = "Pause"

    def steer(self, job: Job | None) -> None:
        if job is None or not job.alive:
            raise contract.RaucaError("Nothing is running that could be paused")
        job.pause()


class RAUCA_OT_continue_job(_JobOperator, bpy.types.Operator):
    """Go on where the job was paused, with the settings it was started with"""

    bl_idname = "rauca.continue_job"
    bl_label = "Go On"

    def steer(self, job: Job | None) -> None:
        if job is None or job.phase != "paused":
            raise contract.RaucaError("Nothing is paused")
        job.go_on()


class RAUCA_OT_stop_job(_JobOperator, bpy.types.Operator):
    """End the job; what is finished is kept. Press again to end it without waiting for what is in hand"""

    bl_idname = "rauca.stop_job"
    bl_label = "Stop"

    def steer(self, job: Job | None) -> None:
        if job is None or not job.alive:
            raise contract.RaucaError("Nothing is running that could be stopped")
        job.stop()
