"""Pause a job, let it go on, stop it."""

from __future__ import annotations

import bpy

from ..background import watch
from ..background.job import Job
from ..core import contract
from .operator import RaucaOperator


class _SteerJob(RaucaOperator):
    """Base of an operator on a job under way."""

    job: bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})  # type: ignore[valid-type]

    def work(self, context: bpy.types.Context) -> None:
        self.steer(watch.job(self.job))
        watch.redraw()

    def steer(self, job: Job | None) -> None:
        """Do it; raises :class:`RaucaError` where ``job`` is not in the phase for it."""
        raise NotImplementedError


class RAUCA_OT_pause_job(_SteerJob, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Finish what is in hand, then leave the machine alone until you go on; nothing is lost"""

    bl_idname = "rauca.pause_job"
    bl_label = "Pause"

    def steer(self, job: Job | None) -> None:
        if job is None or not job.alive:
            raise contract.RaucaError("Nothing is running that could be paused")
        job.pause()


class RAUCA_OT_continue_job(_SteerJob, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Go on where the job was paused, with the settings it was started with"""

    bl_idname = "rauca.continue_job"
    bl_label = "Go On"

    def steer(self, job: Job | None) -> None:
        if job is None or job.phase != "paused":
            raise contract.RaucaError("Nothing is paused")
        job.go_on()


class RAUCA_OT_stop_job(_SteerJob, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """End the job; what is finished is kept. Press again to end it without waiting for what is in hand"""

    bl_idname = "rauca.stop_job"
    bl_label = "Stop"

    def steer(self, job: Job | None) -> None:
        if job is None or not job.alive:
            raise contract.RaucaError("Nothing is running that could be stopped")
        job.stop()


CLASSES = (RAUCA_OT_pause_job, RAUCA_OT_continue_job, RAUCA_OT_stop_job)
