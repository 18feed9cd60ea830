"""The add-on's preferences: the manual, the Python outside Blender that optimizes, and the detectors it has."""

from __future__ import annotations

import platform
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import bpy
from bpy.app.translations import pgettext_iface as iface

from .core import contract
from .folders import size_words
from .jobs import watch
from .jobs.background import Job
from .steps.job_panel import draw_button
from .steps.operator import BackgroundOperator, Obstacle
from .steps.panel import paragraph
from .steps.python_check import CheckTask, verdict

CHECK, SETUP = "check", "setup"
NO_PYTHON = Obstacle("Choose the Python in which rauca is installed", lambda context: not named_python(context))
# Of a Python with torch and all that rauca wants, on the disk (measured); on Linux torch brings CUDA's libraries.
PYTHON_BYTES, WITH_CUDA_BYTES = 2_000_000_000, 8_000_000_000


def _forget_verdict(self: RaucaPreferences, context: bpy.types.Context) -> None:
    """Another Python: what was found of the last one says nothing of it."""
    self.ready, self.verdict, self.command = False, "", ""


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
    command: bpy.props.StringProperty(options={"HIDDEN"})  # that mends what the verdict says is lacking
    package: bpy.props.StringProperty(
        name="Package",
        default="rauca",
        description="What is installed in a Python that is made here: the name of rauca's package, or its wheel's path",
    )
    detectors: bpy.props.CollectionProperty(type=RaucaDetector, options={"HIDDEN"})

    def draw(self, context: bpy.types.Context) -> None:
        draw_manual(self.layout)
        draw_python(context, self.layout)
        self.layout.prop(self, "package")

    def program(self) -> Path:
        """The Python's path, which may be relative to nothing but the .blend or the home folder."""
        return Path(bpy.path.abspath(self.python.strip())).expanduser().absolute()

    def keep(self, python: Path, found: Mapping[str, Any]) -> None:
        """Keep what a check found; detectors that were chosen stay so, and one is chosen to begin with."""
        self.ready, self.verdict, self.command = verdict(python, found)
        chosen, names = set(self.chosen_detectors()), found.get("detectors", ()) if self.ready else ()
        self.detectors.clear()
        for name in names:
            added = self.detectors.add()
            added.name, added.use = name, name in chosen
        if names and not self.chosen_detectors():
            self.detectors[0].use = True

    def chosen_detectors(self) -> list[str]:
        return [detector.name for detector in self.detectors if detector.use]


def manual_page(name: str) -> Path:
    """A page of the manual as the extension carries it, else as a checkout has it; may not be there."""
    here = Path(__file__).parent
    carried = here / "manual" / f"{name}.txt"
    return carried if carried.is_file() else here.parent / "docs" / f"{name}.md"


def draw_manual(layout: bpy.types.UILayout) -> None:
    """Buttons that open the manual; its pages lie beside the add-on, so that they need no connection."""
    row = layout.row()
    for name, label in (("artists-guide", iface("Step by Step")), ("glossary", iface("Glossary"))):
        if (page := manual_page(name)).is_file():
            row.operator("wm.path_open", text=label, icon="HELP", translate=False).filepath = str(page)


def preferences(context: bpy.types.Context) -> RaucaPreferences | None:
    """The add-on's preferences; None while it is registered without being enabled."""
    found = context.preferences.addons.get(__package__)
    return cast("RaucaPreferences", found.preferences) if found is not None else None


def named_python(context: bpy.types.Context) -> str:
    """The external Python as it was typed; empty where none is chosen."""
    settings = preferences(context)
    return settings.python.strip() if settings is not None else ""


def lacks_python(context: bpy.types.Context) -> str:
    """What to do before anything can run in the external Python; empty when all is there."""
    settings = preferences(context)
    if settings is None or not named_python(context):
        return iface("Choose the Python in which rauca is installed")
    if watch.busy(CHECK):
        return iface("Checking the chosen Python")
    if not settings.ready:
        return iface("Press Check: the chosen Python is not known to have what it needs")
    return "" if settings.chosen_detectors() else iface("Choose a detector")


def asks_for_python(context: bpy.types.Context, job: str) -> bool:
    """Whether a step that needs the external Python shows nothing else, as none is known to be good enough."""
    settings = preferences(context)
    return not watch.busy(job) and (settings is None or not settings.ready)


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
    _draw_setup(context, layout, settings)


def _draw_setup(context: bpy.types.Context, layout: bpy.types.UILayout, settings: RaucaPreferences) -> None:
    """What was found or goes on, and the buttons that mend what is lacking."""
    found = watch.job(SETUP)
    if found is not None and found.alive:
        layout.progress(factor=found.fraction, text=found.doing)
        draw_button(layout, SETUP, "STOP", "Stop", "CANCEL")
        return
    if not settings.ready:
        layout.operator("rauca.make_python", icon="PACKAGE")
    if "weights" in settings.command:
        layout.operator("rauca.fetch_detectors", icon="IMPORT")
    if settings.command:
        layout.operator("rauca.copy_command", icon="COPYDOWN").command = settings.command
    if settings.verdict:
        paragraph(context, layout, settings.verdict, icon="CHECKMARK" if settings.ready else "ERROR")
    elif not settings.ready:
        words = iface("Make a Python takes {disk} on the disk, most of it downloaded")
        paragraph(context, layout, words.format(disk=size_words(python_bytes())), icon="INFO")


def python_bytes() -> int:
    """What a Python for optimizing takes on the disk of such a machine, about."""
    return WITH_CUDA_BYTES if sys.platform == "linux" and platform.machine() == "x86_64" else PYTHON_BYTES


class RAUCA_OT_check_python(BackgroundOperator, bpy.types.Operator):
    """See whether the chosen Python can optimize camouflages, and say what it lacks; takes some seconds"""

    bl_label = "Check"
    job = CHECK
    running = "The check is running"
    obstacles = (NO_PYTHON,)

    def begin(self, context: bpy.types.Context) -> None:
        settings = preferences(context)
        assert settings is not None  # poll
        begin_check(settings)

    def outcome(self, context: bpy.types.Context, job: Job) -> str:
        settings = preferences(context)
        assert settings is not None  # poll
        if not settings.ready:
            raise contract.RaucaError(settings.verdict)
        return str(settings.verdict)


def begin_check(settings: RaucaPreferences) -> None:
    """Ask the chosen Python what it has; raises :class:`RaucaError` where there is none."""
    python = settings.program()
    if not python.is_file():
        settings.keep(python, {})
        raise contract.RaucaError(settings.verdict)
    task = CheckTask.of(python)
    watch.begin(CHECK, task, lambda job: _finish(job, python, task))


def _finish(job: Job, python: Path, task: CheckTask) -> None:
    settings = preferences(bpy.context)
    if settings is not None and job.phase != "stopped":
        settings.keep(python, task.found)
    watch.forget(CHECK)
