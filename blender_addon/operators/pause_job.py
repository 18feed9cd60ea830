"""Pause a job and let it go on."""

from __future__ import annotations

import bpy

from ..background import watch
from ..core import contract
from .operator import RaucaOperator


class RAUCA_OT_pause_job(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Finish what is in hand, then leave the machine alone until you go on; nothing is lost"""

    bl_idname = "rauca.pause_job"
    bl_label = "Pause"

    job: bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})  # type: ignore[valid-type]

    def work(self, context: bpy.types.Context) -> str | None:
        found = watch.job(self.job)
        if found is None or not found.alive:
            raise contract.RaucaError("Nothing is running that could be paused")
        found.pause()
        watch.redraw()
        return None


class RAUCA_OT_continue_job(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Go on where the job was paused, with the settings it was started with"""

    bl_idname = "rauca.continue_job"
    bl_label = "Go On"

    job: bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})  # type: ignore[valid-type]

    def work(self, context: bpy.types.Context) -> str | None:
        found = watch.job(self.job)
        if found is None or found.phase != "paused":
            raise contract.RaucaError("Nothing is paused")
        found.go_on()
        watch.redraw()
        return None


CLASSES = (RAUCA_OT_pause_job, RAUCA_OT_continue_job)
