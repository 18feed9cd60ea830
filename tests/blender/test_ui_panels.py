"""Every panel draws, whatever there is to show: without a window, on a layout that takes every call."""

from __future__ import annotations

import sys
from types import MethodType, SimpleNamespace

import bpy
import numpy as np

from blender_addon import registration
from blender_addon.jobs import watch
from blender_addon.jobs.background import JobUpdate, Task

from .painted_box import painted_box
from .timer import until

TALKS = "import time; print('it works', flush=True); time.sleep(600)"


class Layout:
    def __getattr__(self, name):
        return lambda *given, **more: (self, self) if name == "panel" else self


class Drawn:
    """Stands for a panel that Blender made of its class."""

    def __init__(self, cls) -> None:
        self.cls, self.layout = cls, Layout()

    def __getattr__(self, name):
        found = getattr(self.cls, name)
        return MethodType(found, self) if name.startswith(("draw", "_draw")) else found


def draw_all(shading: str = "SOLID") -> None:
    real = bpy.context
    system = SimpleNamespace(addons=real.preferences.addons, system=SimpleNamespace(ui_scale=1.0))
    space = SimpleNamespace(shading=SimpleNamespace(type=shading, use_scene_world=False))
    context = SimpleNamespace(scene=real.scene, mode=real.mode, preferences=system, region=None, space_data=space)
    for cls in (cls for module in registration.MODULES for cls in registration.classes_of(module)):
        if issubclass(cls, bpy.types.Panel) and (not hasattr(cls, "poll") or cls.poll(context)):
            Drawn(cls).draw(context)
            if hasattr(cls, "draw_header"):
                Drawn(cls).draw_header(context)


def test_settings_are_drawn(addon, tmp_path):
    draw_all()
    painted_box(tmp_path)
    steps = addon.context.scene.rauca
    steps.weather.rain, steps.weather.fog, steps.camouflage.study = 40.0, 10.0, str(tmp_path)
    addon.ops.rauca.show_weather()
    addon.ops.rauca.check_uvs()
    for shading in ("SOLID", "MATERIAL", "RENDERED"):
        draw_all(shading)
    for steps.vehicle.origin, steps.weather.preset in (("FILE", "OWN"), ("COLLECTION", "demo")):
        draw_all()


def test_jobs_are_drawn(addon, tmp_path, monkeypatch):
    pictures = {name: np.zeros((8, 8, 3), np.uint8) for name in ("frame", "uv_map", "painted")}
    told = JobUpdate(3, 9, 10.0, "slow", [{"loss": 1.0, "score": 0.5}] * 2, pictures)
    monkeypatch.setattr(Task, "hear", lambda self, line: told)
    jobs = [watch.begin(name, Task(tmp_path, [sys.executable, "-c", TALKS])) for name in ("dataset", "optimize")]
    until(lambda: all(job.done for job in jobs))
    for steer in (lambda job: None, lambda job: job.pause(), lambda job: job.stop()):
        for job in jobs:
            steer(job)
        draw_all()
    until(lambda: not any(job.alive for job in jobs))
    draw_all()
