"""Step 7: `rauca evaluate` and `rauca assess` in a Python of its own, begun, watched, paused and shown."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from blender_addon.jobs import watch
from blender_addon.preferences import preferences
from blender_addon.scene.vehicle import load_shipped
from blender_addon.steps import cost, evaluate
from blender_addon.steps.camouflage import shown_evaluation
from blender_addon.steps.camouflage.found import read_found
from blender_addon.steps.evaluate import state
from rauca_core.contract import schema
from rauca_core.study.assess import EFFORTS, works_of
from rauca_core.study.assessment import Score, save_assessment
from rauca_core.study.battery import load_battery
from rauca_core.study.cost import cost_of
from rauca_core.study.parts import OWN, PARTS
from rauca_core.study.views import SCALES
from tests.study.assessments import assessment

from .conftest import refusal
from .painted_box import a_box, a_camouflage
from .test_ui_optimize import CHECKED
from .timer import until


@pytest.fixture
def settled(addon):
    """The preferences, as after a check that found two detectors."""
    found = preferences(addon.context)
    found.python = sys.executable
    found.keep(Path(sys.executable), CHECKED)
    return found


def test_what_keeps_an_evaluation_from_starting(addon, settled, tmp_path):
    step = addon.context.scene.rauca.evaluate
    assert "Choose a camouflage in step 6" in refusal(addon.ops.rauca.evaluate)
    a_box()
    path = a_camouflage(tmp_path, atlas_id="0" * 16)
    assert "Choose a folder for the evaluation" in refusal(addon.ops.rauca.evaluate)
    step.folder = str(tmp_path / "found")
    assert "made for Box in another UV layout" in refusal(addon.ops.rauca.evaluate)
    assert not (tmp_path / "found").exists()
    path.unlink()
    until(lambda: state(addon.context).words == "Choose a camouflage in step 6", 30)  # the disk is asked now and then
    step.judged = "DETECTORS"  # which needs none
    assert state(addon.context).words.startswith("Ready: about ")
    (tmp_path / "found").mkdir()
    (tmp_path / "found" / "letter.txt").write_text("")
    assert "holds other files and no evaluation" in refusal(addon.ops.rauca.evaluate)


def test_efforts_are_those_of_the_commands():
    frozen = load_battery()
    assert [vehicle.name for vehicle in frozen.vehicles] == list(evaluate.BATTERY_VEHICLES)
    assert 2 + len(frozen.made_against) == evaluate.BATTERY_PAINTS
    for effort in evaluate.EFFORTS.values():
        work, attack = works_of(vehicles=["sedan"])[effort.budget], EFFORTS[effort.budget]
        assert (effort.views, effort.lit_views) == (work.views, work.lit_views)
        assert effort.steps == work.steps == attack.steps * attack.runs
        assert effort.frames == 2 * SCALES[effort.scale]


def test_the_estimate_is_near_the_commands_own(addon, settled, monkeypatch):
    """The same work, estimated here from frames and by `rauca assess` from CPU seconds on two cores."""
    monkeypatch.setattr(cost, "image_seconds", lambda names: 0.1)
    step = addon.context.scene.rauca.evaluate
    step.judged = "DETECTORS"
    for detector in settled.detectors:
        detector.use = detector.name == "yolov4-tiny"
    theirs = cost_of(works_of()["quick"], 50.0, 100.0, cores=2)
    ours = evaluate.estimate(addon.context)
    assert theirs.seconds / 2 < ours.seconds < 2 * theirs.seconds
    assert ours.size_bytes == pytest.approx(theirs.disk_bytes, rel=0.1)
    step.white_box = False
    views = len(evaluate.BATTERY_VEHICLES) * evaluate.EFFORTS["QUICK"].views
    assert evaluate.estimate(addon.context) == cost.of_evaluation(views, evaluate.BATTERY_PAINTS, ["yolov4-tiny"], 320)
    assert evaluate.estimate(addon.context).seconds < 0.7 * ours.seconds
    assert state(addon.context).kind == "missing"
    step.folder = "/tmp/nowhere"
    assert " MB on the disk" in state(addon.context).words


def test_what_an_optimization_takes_is_learned(addon, settled, tmp_path, monkeypatch):
    monkeypatch.setattr(cost, "own_folder", lambda: tmp_path)
    cost.unregister()
    asked = {"steps": 100, "batch": 4, "detectors": ["a"], "views": 0, "size": 320, "texels": 512}
    guess = cost.of_optimization(**asked)
    assert guess.seconds == pytest.approx(cost.START_S + 100 * 4 * cost.IMAGE_S)
    cost.learn(["a"], 4, [9.0, 2.0, 2.0, 2.0, 2.0])
    cost.unregister()  # another session
    assert cost.of_optimization(**asked).seconds == pytest.approx(cost.START_S + 200.0)
    assert cost.image_seconds(["b"]) == cost.IMAGE_S
    assert cost.size_words(3.4e6) == "3 MB"
    assert cost.size_words(1.44e9) == "1.4 GB"
    (tmp_path / cost.FILE).write_text("{")
    cost.unregister()
    assert cost.of_optimization(**asked).seconds == guess.seconds
    cost.unregister()


def test_an_assessment_of_several_detectors_is_read(tmp_path):
    attacked = Score(0.125, 0.0, 0.25, 0.1, 14)
    save_assessment(tmp_path / "one" / "assess.json", assessment())
    save_assessment(tmp_path / "two" / "assess.json", assessment(attacked))
    one, two = read_found(tmp_path)
    assert one.by == assessment().detector.name
    assert one.worn == {
        "clean": assessment().clean.ap,
        "random": assessment().random.ap,
        "transfer": one.worn["transfer"],
    }
    assert two.worn == {**one.worn, "white_box": 0.125}


@pytest.fixture
def ready(addon, tmp_path):
    """The sedan in noise, to be shown to a real detector in two small views."""
    found = preferences(addon.context)
    found.python = sys.executable
    try:
        addon.ops.rauca.check_python()
    except RuntimeError as error:
        pytest.skip(f"no detector here: {error}")
    for detector in found.detectors:
        detector.use = detector.name == min(one.name for one in found.detectors)
    texels = np.random.default_rng(1).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    a_camouflage(tmp_path, texels, load_shipped("sedan").atlas_id, "sedan")
    addon.ops.rauca.apply_camouflage()
    step = addon.context.scene.rauca.evaluate
    step.folder, step.frames, step.size = str(tmp_path / "found"), 1, 64
    return tmp_path / "found"


def test_a_camouflage_is_judged_paused_and_looked_at(addon, ready):
    addon.context.preferences.edit.use_global_undo = True
    assert addon.ops.rauca.evaluate(wait=False) == {"FINISHED"}
    job = watch.job("evaluate")
    assert state(addon.context).words == "Looking at the detectors and the vehicle"
    longest = until(lambda: job.total > 0 or not job.alive)
    assert job.doing.startswith("rendering views"), job.ending
    assert state(addon.context).words.startswith("Rendering views: ")
    addon.ops.rauca.steer_job(job="evaluate", action="PAUSE")
    until(lambda: job.phase == "paused" or not job.alive)
    assert job.phase == "paused", job.ending
    assert evaluate.found_in(str(ready)) is None
    addon.ops.rauca.steer_job(job="evaluate", action="GO_ON")
    longest = max(longest, until(lambda: not job.alive))
    assert job.phase == "done", job.ending
    assert longest < 0.1
    assert not job.task.scratch.exists()
    told = evaluate.found_in(str(ready))
    assert told is not None
    assert told[0].mean
    assert told[0].by in (*PARTS, OWN)
    assert list(told[0].worn) == ["normal", "spots"]
    assert told[0].worn == told[1].worn  # a single detector
    watch.forget("evaluate")
    assert state(addon.context).kind == "done"
    assert state(addon.context).words.startswith("Found ")
    scene = addon.context.scene
    assert scene.rauca.camouflage.study == str(ready)
    scene.rauca.evaluate.size = 65
    addon.ops.ed.undo_push(message="a size")
    addon.ops.ed.undo()
    assert addon.context.scene.rauca.camouflage.study == str(ready)  # undo keeps what the job filled in
    assert addon.ops.rauca.evaluated_view(step="WORST") == {"FINISHED"}
    views = shown_evaluation.load_now(str(ready))
    first = addon.context.scene.rauca.camouflage.frame
    assert first == max(views.evaluated_frames, key=lambda one: one.sureness("spots")).frame
    assert addon.context.scene.camera.data.background_images[0].image is not None
    assert schema.read_json(ready / "evaluated.json").raw("finished") is True
