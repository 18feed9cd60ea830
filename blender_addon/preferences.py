"""The add-on's preferences: the Python outside Blender that optimizes camouflages, and the detectors it has."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import bpy
from bpy.app.translations import pgettext_iface as iface
from bpy.app.translations import pgettext_rpt as rpt

from .core import contract
from .jobs import watch
from .jobs.background import Job
from .steps.job_panel import draw_button
from .steps.operator import BackgroundOperator
from .steps.panel import paragraph
from .steps.python_check import CheckTask, verdict

CHECK = "check"


def _forget_verdict(self: RaucaPreferences, context: bpy.types.Context) -> None:
    """Another Python: what was found of the last one says nothing of it."""
    self.ready, self.verdict = False, ""


class RaucaDetector(bpy.types.PropertyGroup):
    """A detector that the external Python has; ``name`` is inherited."""

    use: bpy.props.BoolProperty(name="Attack", description="Make the camouflage against this detector")


class RaucaPreferences(bpy.types.AddonPreferences):
    """Preferences of the extension."""

    bl_idname = __package__

    python: bpy.props.StringProperty(
        name="Python",
        subtype="FILE_PATH",
        update=_forget_verdict,
        description="Program of the Python in which rauca and torch are installed, such as .venv/bin/python",
    )
    ready: bpy.props.BoolProperty(options={"HIDDEN"})
    verdict: bpy.props.StringProperty(options={"HIDDEN"})
    detectors: bpy.props.CollectionProperty(type=RaucaDetector, options={"HIDDEN"})

    def draw(self, context: bpy.types.Context) -> None:
        draw_python(context, self.layout)

    def program(self) -> Path:
        """The Python's path, which may be relative to nothing but the .blend or the home folder."""
        return Path(bpy.path.abspath(self.python.strip())).expanduser().absolute()

    def keep(self, python: Path, found: Mapping[str, Any]) -> None:
        """Keep what a check found; detectors that were chosen stay so, and one is chosen to begin with."""
        self.ready, self.verdict = verdict(python, found)
        chosen, names = set(self.chosen_detectors()), found.get("detectors", ()) if self.ready else ()
        self.detectors.clear()
        for name in names:
            added = self.detectors.add()
            added.name, added.use = name, name in chosen
        if names and not self.chosen_detectors():
            self.detectors[0].use = True

    def chosen_detectors(self) -> list[str]:
        return [detector.name for detector in self.detectors if detector.use]


def preferences(context: bpy.types.Context) -> RaucaPreferences | None:
    """The add-on's preferences; None while it is registered without being enabled."""
    found = context.preferences.addons.get(__package__)
    return cast("RaucaPreferences", found.preferences) if found is not None else None


def lacks_python(context: bpy.types.Context) -> str:
    """What to do before anything can run in the external Python; empty when all is there."""
    settings = preferences(context)
    if settings is None or not settings.python.strip():
        return iface("Choose the Python in which rauca is installed")
    if watch.busy(CHECK):
        return iface("Checking the chosen Python")
    if not settings.ready:
        return iface("Press Check: the chosen Python is not known to have what it needs")
    return "" if settings.chosen_detectors() else iface("Choose a detector")


def draw_detectors(context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
    """A tick for each detector that the external Python has."""
    settings = preferences(context)
    column = layout.column(heading="Detectors", align=True)
    for detector in settings.detectors if settings is not None else ():
        column.prop(detector, "use", text=detector.name, translate=False)


def draw_python(context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
    """The Python's path, its check and what the check found."""
    settings = preferences(context)
    if settings is None:
        return
    layout.use_property_split = True
    layout.prop(settings, "python")
    if watch.busy(CHECK):
        row = layout.row(align=True)
        row.label(text="Checking ...", icon="TIME")
        draw_button(row, CHECK, "STOP", "Stop")
        return
    layout.operator("rauca.check_python", icon="VIEWZOOM")
    if settings.verdict:
        paragraph(context, layout, settings.verdict, icon="CHECKMARK" if settings.ready else "ERROR")


class RAUCA_OT_check_python(BackgroundOperator, bpy.types.Operator):
    """See whether the chosen Python can optimize camouflages, and say what it lacks; takes some seconds"""

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
        python = settings.program()
        if not python.is_file():
            settings.keep(python, {})
            raise contract.RaucaError(settings.verdict)
        task = CheckTask.of(python)
        watch.begin(CHECK, task, lambda job: _finish(job, python, task))

    def outcome(self, context: bpy.types.Context, job: Job) -> str:
        settings = preferences(context)
        assert settings is not None  # poll
        if not settings.ready:
            raise contract.RaucaError(settings.verdict)
        return str(settings.verdict)


def _finish(job: Job, python: Path, task: CheckTask) -> None:
    settings = preferences(bpy.context)
    if settings is not None and job.phase != "stopped":
        settings.keep(python, task.found)
    watch.forget(CHECK)
