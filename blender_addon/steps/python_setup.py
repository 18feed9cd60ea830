"""No terminal at all: buttons that make the Python for optimizing, fetch detectors, and copy a command."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ..core import contract, files, system
from ..folders import own_folder
from ..jobs import make_python, watch
from ..jobs.background import Job, JobUpdate, Task
from ..preferences import SETUP, begin_check, preferences, python_bytes
from .operator import NO_UNDO, BackgroundOperator, Obstacle, RaucaOperator

EXTRAS = "optimize,report,detectors"
OFFLINE = Obstacle(
    "Blender may not go online: allow it in the preferences, under System, Network",
    lambda context: not getattr(bpy.app, "online_access", True),
)


class SetupTask(Task):
    """Tells how far it is as the programs of rauca do."""

    def hear(self, line: str) -> JobUpdate | None:
        told = contract.parse_progress(line)
        return None if told is None else JobUpdate(told.done, told.total, doing=told.last)


class RAUCA_OT_make_python(BackgroundOperator, bpy.types.Operator):
    """Make a Python with torch and rauca in the extension's own folder, by Blender's; it goes with the extension"""

    bl_label = "Make a Python"
    job = SETUP
    running = "It is being set up; stop that first"
    obstacles = (OFFLINE,)

    def begin(self, context: bpy.types.Context) -> None:
        settings = preferences(context)
        assert settings is not None  # drawn by the add-on's own panel
        folder = own_folder() / "python"
        files.require_space(folder.parent, python_bytes())
        package = settings.package.strip() or "rauca"
        there = Path(bpy.path.abspath(package)).expanduser()
        wanted = f"{there.absolute() if there.exists() else package}[{EXTRAS}]"
        task = SetupTask(folder, [sys.executable, str(Path(make_python.__file__)), str(folder), "torch", wanted])
        watch.begin(SETUP, task, _take)


def _take(job: Job) -> None:
    """Choose the Python that was made, and see what it has."""
    settings = preferences(bpy.context)
    if settings is None or job.phase == "stopped":
        watch.forget(SETUP)
    elif job.phase == "done":
        watch.forget(SETUP)
        settings.python = str(system.python_in(job.task.folder))
        begin_check(settings)
    else:
        settings.verdict = job.ending


class RAUCA_OT_fetch_detectors(BackgroundOperator, bpy.types.Operator):
    """Download the seven detectors of the standard evaluation, 210 MB, into the user's cache"""

    bl_label = "Fetch Detectors"
    job = SETUP
    running = "It is being set up; stop that first"
    obstacles = (OFFLINE,)

    def begin(self, context: bpy.types.Context) -> None:
        settings = preferences(context)
        if settings is None or not settings.python.strip():
            raise contract.RaucaError(rpt("Choose the Python in which rauca is installed"))
        python = settings.program()
        command = [str(python), "-P", "-m", "pipelines", "weights", "fetch", "--all"]
        watch.begin(SETUP, SetupTask(python.parent, command), _fetched)


def _fetched(job: Job) -> None:
    settings = preferences(bpy.context)
    if settings is not None and job.phase == "failed":
        settings.verdict = job.ending
    watch.forget(SETUP)
    if settings is not None and job.phase == "done":
        begin_check(settings)


class RAUCA_OT_copy_command(RaucaOperator, bpy.types.Operator):
    """Copy the command to the clipboard, for a terminal"""

    bl_label = "Copy Command"
    bl_options = NO_UNDO
    command: bpy.props.StringProperty(options={"SKIP_SAVE", "HIDDEN"})

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return str(properties.command)

    def work(self, context: bpy.types.Context) -> str:
        context.window_manager.clipboard = self.command
        return rpt("Copied: {command}").format(command=self.command)
