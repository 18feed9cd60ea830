"""The jobs of this Blender, looked after by a timer that loading a file and undoing leave alone.

When the add-on is disabled or Blender ends, every job is asked to stop: its child finishes what it has in hand, and the
same settings go on from there another time.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable

import bpy

from . import pictures
from .background import Job, Task
from .thumbnails import curve

INTERVAL_S = 0.1
CURVE_EVERY_S = 0.5

_jobs: dict[str, Job] = {}
_curve_at: dict[str, float] = {}  # when each job's was last drawn


def job(name: str) -> Job | None:
    """The newest job of that name, at work or ended; None if there was none."""
    return _jobs.get(name)


def busy(name: str) -> bool:
    """Whether a job of that name works or waits to go on."""
    found = _jobs.get(name)
    return found is not None and found.alive


def begin(name: str, task: Task, when_done: Callable[[Job], None] | None = None) -> Job:
    """Start a job and look after it; raises as :class:`Job`."""
    assert not busy(name)
    started = Job(task, when_done)
    forget(name)
    _jobs[name] = started
    if not bpy.app.timers.is_registered(_beat):
        bpy.app.timers.register(_beat, first_interval=INTERVAL_S, persistent=True)
    return started


def tick() -> None:
    """Look after every job once; takes a few milliseconds."""
    for name, found in list(_jobs.items()):
        if found.tick():
            _show(name, found)
            redraw()
        if found.phase == "paused" and (paused := found.when_paused):
            found.when_paused = None
            paused(found)
            redraw()
        if not found.alive and (told := found.when_done):
            found.when_done = None
            told(found)
            redraw()


def run_to_end(name: str) -> Job:
    """Wait for a job, for scripts without a window."""
    found = _jobs[name]
    while found.alive and found.phase != "paused":
        tick()
        time.sleep(INTERVAL_S)
    tick()
    return found


def forget(name: str) -> None:
    """Drop an ended job and its pictures."""
    _jobs.pop(name, None)
    _curve_at.pop(name, None)
    pictures.forget(f"{name}.")


def redraw() -> None:
    """Draw the sidebars of the 3D views, and the preferences, anew."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "PREFERENCES":
                area.tag_redraw()
            for region in area.regions if area.type == "VIEW_3D" else ():
                if region.type == "UI":
                    region.tag_redraw()


def unregister() -> None:
    """Let every child finish what it has in hand and end, without waiting for it."""
    for found in _jobs.values():
        if found.alive:
            found.stop()
            found.task.clean()
    _jobs.clear()
    if bpy.app.timers.is_registered(_beat):
        bpy.app.timers.unregister(_beat)
    pictures.close()


def _beat() -> float | None:
    try:
        tick()
    except Exception:
        # Blender drops a timer that raises, and with it every other job's: tell, and look after them again.
        traceback.print_exc()
    return INTERVAL_S if any(found.alive for found in _jobs.values()) else None


def _show(name: str, found: Job) -> None:
    """Hand new pictures to the panels; the curve now and then, and at the end."""
    for kind in list(found.pictures):
        pictures.show(f"{name}.{kind}", found.pictures.pop(kind))
    now = time.monotonic()
    due = now - _curve_at.get(name, 0.0) >= CURVE_EVERY_S or not found.alive
    if due and "loss" in found.history:
        _curve_at[name] = now
        pictures.show(f"{name}.loss", curve(found.history["loss"]))
