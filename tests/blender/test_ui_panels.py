"""Every panel draws, whatever there is to show: without a window, on a layout that takes every call."""

from __future__ import annotations

import sys
from pathlib import Path
from types import MethodType, SimpleNamespace

import bpy
import numpy as np

from blender_addon import registration
from blender_addon.jobs import watch
from blender_addon.jobs.background import JobUpdate, Task
from blender_addon.preferences import preferences
from blender_addon.steps import dataset, evaluate, optimize
from blender_addon.steps.camouflage import panel as camouflage_panel
from blender_addon.steps.panel import State
from blender_addon.steps.weather import panel as weather_panel

from .painted_box import painted_box
from .test_ui_optimize import CHECKED
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


class Recorder:
    """A layout that notes its buttons and settings in order, each with the height that it takes: one row."""

    def __init__(self, rows: list[str]) -> None:
        self.rows = rows

    def __getattr__(self, name):
        def call(*given, **more):
            if name == "operator":
                self.rows.append(given[0])
            elif name == "prop":
                self.rows.append(given[1])
            elif name == "progress":
                self.rows.append("progress")
            elif name in ("label", "template_icon"):
                self.rows.append(name)
            return (self, self) if name == "panel" else Recorder(self.rows)

        return call


def drawn(cls) -> list[str]:
    """The rows of a step's panel, from the top."""
    real, panel = bpy.context, Drawn(cls)
    panel.layout = Recorder([])
    system = SimpleNamespace(addons=real.preferences.addons, system=SimpleNamespace(ui_scale=1.0))
    panel.draw(SimpleNamespace(scene=real.scene, mode=real.mode, preferences=system, region=None, space_data=None))
    return panel.layout.rows


def places(rows: list[str], *starts: str) -> dict[str, int]:
    """Where every button and setting is; a job's progress stands in the place of what begins it."""
    return {"start" if row in ("progress", *starts) else row: i for i, row in enumerate(rows) if row != "label"}


def test_buttons_stay_in_their_places_whatever_the_state_says(addon, tmp_path):
    """A job begins, works, is paused and stops; folders come and go: no button or setting moves by a row."""
    settings = preferences(addon.context)
    settings.keep(Path(sys.executable), CHECKED)
    for cls, more, name, start in (
        (dataset.RAUCA_PT_dataset, dataset.RAUCA_PT_dataset_more, "dataset", "rauca.generate_dataset"),
        (optimize.RAUCA_PT_optimize, optimize.RAUCA_PT_optimize_more, "optimize", "rauca.optimize"),
        (evaluate.RAUCA_PT_evaluate, evaluate.RAUCA_PT_evaluate_more, "evaluate", "rauca.evaluate"),
    ):
        step = getattr(addon.context.scene.rauca, name)
        before = places(drawn(cls), start)
        step.folder = str(tmp_path / name)
        assert places(drawn(cls), start) == before
        job = watch.begin(name, Task(tmp_path / name, [sys.executable, "-c", TALKS]))
        for steer in (lambda job: None, lambda job: job.pause(), lambda job: job.stop()):
            steer(job)
            assert places(drawn(cls), start) == before
            assert not hasattr(more, "poll") or more.poll(addon.context)  # its header stays, too
        until(lambda job=job: not job.alive)
        assert places(drawn(cls), start) == before
        assert before["start"] < before["rauca.steer_job"] < before["wm.path_open"]


def test_a_states_sentence_keeps_its_room(addon, monkeypatch):
    """One line or four: what follows the sentence stays where the longest so far has put it, and never goes back up."""
    panel = camouflage_panel.RAUCA_PT_camouflage
    monkeypatch.setattr(panel, "reserved", {})
    heights = []
    for words in ("short", "a sentence of many words that needs more lines than two " * 2, "short", "x"):
        monkeypatch.setattr(panel, "step_state", staticmethod(lambda context, words=words: State("ready", words)))
        heights.append(drawn(panel).count("label"))
    assert heights[0] == 2
    assert heights[1] > 4
    assert heights[2:] == [heights[1]] * 2


def test_the_weathers_sliders_stay_while_its_caveats_change(addon, tmp_path):
    painted_box(tmp_path)
    weather = addon.context.scene.rauca.weather
    rows = [drawn(weather_panel.RAUCA_PT_weather)]
    addon.ops.rauca.show_weather()
    rows.append(drawn(weather_panel.RAUCA_PT_weather))
    weather.rain = 50.0
    rows.append(drawn(weather_panel.RAUCA_PT_weather))
    assert len({row.index("sun_altitude") for row in rows}) == 1
    assert len(rows[2]) > len(rows[0])
