"""No terminal at all: buttons that make the Python for optimizing, fetch detectors, and copy a command."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import ClassVar

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ..core import files, system
from ..folders import own_folder
from ..jobs import make_python, watch
from ..jobs.background import Job, Task
from ..preferences import NO_PYTHON, SETUP, begin_check, preferences, python_bytes
from .operator import NO_UNDO, BackgroundOperator, Obstacle, RaucaOperator

EXTRAS = "optimize,report,detectors"
OFFLINE = Obstacle(
    "Blender may not go online: allow it in the preferences, under System, Network",
    lambda context: not getattr(bpy.app, "online_access", True),
)


class SetupOperator(BackgroundOperator):
    """Base of what brings something that is lacking; one at a time."""

    job = SETUP
    running = "It is being set up; stop that first"
    obstacles: ClassVar[tuple[Obstacle, ...]] = (OFFLINE,)

    def set_up(self, task: Task, made: Path | None = None) -> None:
        """Begin; afterwards choose the Python that was ``made``, if any, and see what the chosen one has."""
        watch.begin(SETUP, task, lambda job: _end(job, made))


def _end(job: Job, made: Path | None) -> None:
    watch.forget(SETUP)
    settings = preferences(bpy.context)
    if settings is None:
        return
    if job.phase == "failed":
        settings.verdict = job.ending
    elif job.phase == "done":
        if made is not None:
            settings.python = str(made)
        begin_check(settings)


class RAUCA_OT_make_python(SetupOperator, bpy.types.Operator):
    """Make a Python with torch and rauca in the extension's own folder, by Blender's; it goes with the extension"""

    bl_label = "Make a Python"

    def begin(self, context: bpy.types.Context) -> None:
        settings = preferences(context)
        assert settings is not None  # drawn by the add-on's own panel
        folder = own_folder() / "python"
        files.require_space(folder.parent, python_bytes())
        package = settings.package.strip() or "rauca"
        there = Path(bpy.path.abspath(package)).expanduser()
        wanted = f"{there.absolute() if there.exists() else package}[{EXTRAS}]"
        command = [sys.executable, str(Path(make_python.__file__)), str(folder), "torch", wanted]
        self.set_up(Task(folder, command), made=system.python_in(folder))


class RAUCA_OT_fetch_detectors(SetupOperator, bpy.types.Operator):
    """Download the seven detectors of the standard evaluation, 210 MB, into the user's cache"""

    bl_label = "Fetch Detectors"
    obstacles = (OFFLINE, NO_PYTHON)

    def begin(self, context: bpy.types.Context) -> None:
        settings = preferences(context)
        assert settings is not None  # poll
        python = settings.program()
        self.set_up(Task(python.parent, [str(python), "-P", "-m", "pipelines", "weights", "fetch", "--all"]))


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
