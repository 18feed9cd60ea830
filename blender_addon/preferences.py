"""The add-on's preferences: the Python outside Blender that optimizes camouflages, and the detectors it has."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from .core import contract
from .jobs import watch
from .jobs.background import Job
from .jobs.endings import Ending
from .steps.operator import BackgroundOperator
from .steps.panel import paragraph
from .steps.python_check import CheckTask, verdict

CHECK = "check"


def _forget_verdict(self: RaucaPreferences, context: bpy.types.Context) -> None:
    """Another Python: what was found of the last one says nothing of it."""
    self.ready, self.verdict = False, ""


class RaucaDetector(bpy.types.PropertyGroup):
    """A detector that the external Python has; ``name`` is inherited."""

    use: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Attack", description="Make the camouflage against this detector"
    )


class RaucaPreferences(bpy.types.AddonPreferences):
    """Preferences of the extension."""

    bl_idname = __package__

    python: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Python",
        subtype="FILE_PATH",
        update=_forget_verdict,
        description="Program of the Python in which rauca and torch are installed, such as .venv/bin/python",
    )
    ready: bpy.props.BoolProperty(options={"HIDDEN"})  # type: ignore[valid-type]
    verdict: bpy.props.StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]
    detectors: bpy.props.CollectionProperty(type=RaucaDetector, options={"HIDDEN"})  # type: ignore[valid-type]

    def draw(self, context: bpy.types.Context) -> None:
        draw_python(context, self.layout)

    def program(self) -> Path:
        """The Python's path, which may be relative to nothing but the .blend or the home folder."""
        return Path(bpy.path.abspath(self.python.strip())).expanduser().absolute()

    def keep(self, ready: bool, verdict: str, detectors: tuple[str, ...]) -> None:
        """Keep what a check found; detectors that were chosen stay so, and one is chosen to begin with."""
        chosen = {detector.name for detector in self.detectors if detector.use}
        self.ready, self.verdict = ready, verdict
        self.detectors.clear()
        for name in detectors:
            added = self.detectors.add()
            added.name, added.use = name, name in chosen
        if detectors and not any(detector.use for detector in self.detectors):
            self.detectors[0].use = True

    def chosen_detectors(self) -> list[str]:
        return [detector.name for detector in self.detectors if detector.use]


def preferences(context: bpy.types.Context) -> RaucaPreferences | None:
    """The add-on's preferences; None while it is registered without being enabled."""
    found = context.preferences.addons.get(__package__)
    return cast("RaucaPreferences", found.preferences) if found is not None else None


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
        row.operator("rauca.stop_job", text="Stop").job = CHECK
        return
    layout.operator("rauca.check_python", icon="VIEWZOOM")
    if settings.verdict:
        paragraph(context, layout, settings.verdict, icon="CHECKMARK" if settings.ready else "ERROR")


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


CLASSES = (
    RaucaDetector,
    RaucaPreferences,
    RAUCA_OT_check_python,
)
