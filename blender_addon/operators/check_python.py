"""Ask the external Python what it has."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ..background import watch
from ..background.endings import Ending
from ..background.job import Job
from ..background.python_check import CheckTask, verdict
from ..core import contract
from ..preferences import CHECK, preferences
from .background_operator import BackgroundOperator


class RAUCA_OT_check_python(BackgroundOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """See whether the chosen Python can optimize camouflages, and say what it lacks; takes some seconds"""

    bl_idname = "rauca.check_python"
    bl_label = "Check"
    job = CHECK
    running = "The check is running"

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        settings = preferences(context)
        if settings is None or not settings.python.strip():
            return rpt("Choose the Python in which rauca is installed")
        return super().obstacle(context)

    def begin(self, context: bpy.types.Context) -> None:
        settings = preferences(context)
        assert settings is not None  # poll
        task = CheckTask(settings.program())
        if not task.python.is_file():
            _keep(task)
            raise contract.RaucaError(settings.verdict)
        watch.begin(CHECK, task, lambda job: _finish(job, task))

    def outcome(self, context: bpy.types.Context, how: Ending) -> str:
        settings = preferences(context)
        assert settings is not None  # poll
        if not settings.ready:
            raise contract.RaucaError(settings.verdict)
        return str(settings.verdict)


def _finish(job: Job, task: CheckTask) -> None:
    if job.phase != "stopped":
        _keep(task)
    watch.forget(CHECK)


def _keep(task: CheckTask) -> None:
    settings = preferences(bpy.context)
    if settings is not None:
        found = verdict(task.python, task.found)
        settings.keep(found.ready, rpt(found.text).format(**found.values), tuple(found.detectors))


CLASSES = (RAUCA_OT_check_python,)
