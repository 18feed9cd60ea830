"""Stop a job."""

from __future__ import annotations

import bpy

from ..background import watch
from ..core import contract
from .operator import RaucaOperator


class RAUCA_OT_stop_job(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """End the job; what is finished is kept. Press again to end it without waiting for what is in hand"""

    bl_idname = "rauca.stop_job"
    bl_label = "Stop"

    job: bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})  # type: ignore[valid-type]

    def work(self, context: bpy.types.Context) -> str | None:
        found = watch.job(self.job)
        if found is None or not found.alive:
            raise contract.RaucaError("Nothing is running that could be stopped")
        found.stop()
        watch.redraw()
        return None


CLASSES = (RAUCA_OT_stop_job,)
