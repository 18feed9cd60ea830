"""Step 5: `rauca optimize` in a Python of its own, started, watched, paused and taken up again from the panel."""

from __future__ import annotations

import json
import os
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

from benchmarks.stability.drawn import make_dataset
from blender_addon.jobs import pictures, watch
from blender_addon.preferences import preferences
from blender_addon.steps.dataset import DatasetTask
from blender_addon.steps.optimize import state
from blender_addon.steps.python_check import verdict
from rauca_core.contract import load_camouflage
from tests.blender.conftest import refusal
from tests.blender.timer import until

STEPS = 6
CHECKED = {
    "version": [3, 12, 1], "torch": "2", "device": "CPU", "rauca": "0.0.1", "speaks": True,
    "detectors": ["yolov3-tiny", "yolov4-tiny"],
}  # fmt: skip


@pytest.fixture
def settings(addon):
    """The add-on's preferences."""
    return preferences(addon.context)


@pytest.fixture
def ready(addon, settings, box_vehicle, tmp_path):
    """Step 5 ready to start on a small data set: asks for its settings, which loading a file replaces."""
    settings.python = sys.executable
    try:
        addon.ops.rauca.check_python()
    except RuntimeError as error:
        pytest.skip(f"no detector to attack here: {error}")
    for detector in settings.detectors:
        detector.use = detector.name == min((d.name for d in settings.detectors), key=_lightness)
    make_dataset(tmp_path / "data", box_vehicle, 64, (40.0, 130.0))
    step = addon.context.scene.rauca.optimize
    step.dataset, step.folder = str(tmp_path / "data"), str(tmp_path / "made")
    step.steps, step.batch, step.map_size = STEPS, 1, 64
    return lambda: addon.context.scene.rauca.optimize


def _lightness(name: str) -> tuple[bool, str]:
    return name != "yolov3-tiny", name


def test_a_run_is_watched_paused_and_ends_in_a_camouflage(addon, ready, tmp_path):
    assert state(addon.context).words.startswith("Ready to optimize")
    assert addon.ops.rauca.optimize(wait=False) == {"FINISHED"}
    job = watch.job("optimize")
    assert state(addon.context).words == "Reading the dataset and the detectors"
    longest = until(lambda: job.done >= 2)
    assert state(addon.context).words.startswith(f"{job.done} of {STEPS} steps, about ")
    assert not addon.ops.rauca.optimize.poll()

    addon.ops.rauca.steer_job(job="optimize", action="PAUSE")
    longest = max(longest, until(lambda: job.phase == "paused"))
    stood = json.loads((tmp_path / "made" / "checkpoints" / "checkpoint.json").read_text())["step"]
    assert 2 <= stood < STEPS
    addon.ops.wm.read_homefile(use_empty=True, load_ui=False)
    addon.ops.rauca.steer_job(job="optimize", action="GO_ON")
    longest = max(longest, until(lambda: not job.alive))

    assert job.phase == "done", job.ending
    written = [json.loads(line) for line in (tmp_path / "made" / "history.jsonl").read_text().splitlines()]
    assert [line["step"] for line in written] == list(range(1, STEPS + 1))
    assert job.history["loss"] == [line["loss"] for line in written]
    assert tuple(pictures.shown("optimize.uv_map").image_size) == (64, 64)
    for kind in ("painted", "loss"):
        assert pictures.shown(f"optimize.{kind}") is not None
    made, _ = load_camouflage(tmp_path / "made" / "camouflage.json")
    assert made.size == 64
    assert addon.context.scene.rauca.camouflage.file == ""  # this file is not the one that asked for it
    ready().folder, ready().steps = str(tmp_path / "made"), STEPS
    assert state(addon.context).words == f"Finished: {STEPS} of {STEPS} steps"
    watch.forget("optimize")
    assert state(addon.context).words == f"rauca is there, after {STEPS} steps"
    assert longest < 0.1


def test_a_camouflage_is_used_while_it_is_made_and_can_be_undone(addon, ready, tmp_path):
    """Use Now writes what is there and goes on; the finished one takes its place, and undo keeps it."""
    addon.context.preferences.edit.use_global_undo = True
    file = lambda: Path(addon.context.scene.rauca.camouflage.file)  # noqa: E731
    assert "No optimization" in refusal(addon.ops.rauca.use_now)
    addon.ops.rauca.optimize(wait=False)
    job = watch.job("optimize")
    until(lambda: job.done >= 1)
    assert addon.ops.rauca.use_now() == {"FINISHED"}
    until(lambda: file().name == "unfinished.json" or not job.alive)
    if file().name == "unfinished.json":  # else it was done first
        assert 1 <= load_camouflage(file())[0].made["steps"] < STEPS
    until(lambda: not job.alive)
    assert job.phase == "done", job.ending
    assert file() == tmp_path / "made" / "camouflage.json"
    ready().title = "changed since"
    addon.ops.ed.undo_push(message="a title")
    addon.ops.ed.undo()
    assert (ready().title, file()) == ("rauca", tmp_path / "made" / "camouflage.json")


def test_a_stopped_run_can_be_used(addon, ready, tmp_path):
    addon.ops.rauca.optimize(wait=False)
    until(lambda: watch.job("optimize").done >= 2)
    addon.ops.rauca.steer_job(job="optimize", action="STOP")
    until(lambda: not watch.busy("optimize"))
    took = json.loads((tmp_path / "made" / "checkpoints" / "checkpoint.json").read_text())["step"]
    assert state(addon.context).words == f"Stands after {took} of {STEPS} steps; Optimize goes on"
    assert addon.ops.rauca.use_now() == {"FINISHED"}
    used = Path(addon.context.scene.rauca.camouflage.file)
    assert load_camouflage(used)[0].made["steps"] == took
    ready().steps = 1  # fewer than were taken
    assert f"holds a run of {took} steps already" in refusal(addon.ops.rauca.optimize)
    assert used.exists()


def test_a_stopped_run_goes_on_and_another_one_is_refused(addon, ready, tmp_path):
    addon.ops.rauca.optimize(wait=False)
    until(lambda: watch.job("optimize").done >= 2)
    addon.ops.rauca.steer_job(job="optimize", action="STOP")
    until(lambda: not watch.busy("optimize"))
    first = list(watch.job("optimize").history["loss"])
    assert watch.job("optimize").phase == "stopped"
    ready().seed = 1
    assert "seed" in refusal(addon.ops.rauca.optimize)
    ready().seed = 0
    assert addon.ops.rauca.optimize() == {"FINISHED"}
    whole = watch.job("optimize").history["loss"]
    assert len(whole) == STEPS
    assert whole[: len(first)] == first


def test_what_keeps_a_run_from_starting(addon, settings, tmp_path, box_vehicle):
    step = addon.context.scene.rauca.optimize

    assert "Choose the Python in which rauca is installed" in refusal(addon.ops.rauca.optimize)
    settings.python = sys.executable
    assert "Press Check" in refusal(addon.ops.rauca.optimize)
    settings.keep(Path(sys.executable), CHECKED)
    settings.detectors[0].use = False
    assert "Choose a detector" in refusal(addon.ops.rauca.optimize)
    settings.detectors[1].use = True
    assert "Generate a dataset, or choose one" in refusal(addon.ops.rauca.optimize)
    addon.context.scene.rauca.dataset.folder = str(tmp_path / "data")  # step 4's is taken
    assert "Choose a folder for the camouflage" in refusal(addon.ops.rauca.optimize)
    step.folder = str(tmp_path / "made")
    assert "dataset.json" in refusal(addon.ops.rauca.optimize)
    make_dataset(tmp_path / "data", box_vehicle, 64, (40.0,))
    plan = tmp_path / "data" / "dataset.json"
    plan.write_text(plan.read_text().replace('"light": true', '"light": false'))
    assert "render it again with Light Maps on, in step 4" in refusal(addon.ops.rauca.optimize)
    plan.write_text(plan.read_text().replace('"light": false', '"light": true'))
    (tmp_path / "made").mkdir()
    (tmp_path / "made" / "letter.txt").write_text("")
    assert "holds other files and no camouflage" in refusal(addon.ops.rauca.optimize)
    assert os.listdir(tmp_path / "made") == ["letter.txt"]


def test_a_data_set_in_the_making_is_waited_for(addon, settings, tmp_path):
    settings.python = sys.executable
    settings.keep(Path(sys.executable), CHECKED)
    watch.begin(
        "dataset",
        DatasetTask(tmp_path / "data", [sys.executable, "-c", "import time; time.sleep(600)"], tmp_path / "none"),
    )
    step = addon.context.scene.rauca.optimize
    step.dataset, step.folder = str(tmp_path / "data"), str(tmp_path / "made")
    assert "still being rendered; wait for it" in refusal(addon.ops.rauca.optimize)


def a_python(folder: Path) -> Path:
    """A new environment of this Python, with nothing in it."""
    venv.create(folder, with_pip=False, symlinks=True)
    return folder / "bin" / "python"


def a_package(python: Path, name: str, code: str) -> None:
    site = next((python.parent.parent / "lib").glob("python*")) / "site-packages"
    (site / f"{name}.py").write_text(code)


def checked(addon, settings, python: Path) -> str:
    settings.python = str(python)
    assert (settings.ready, settings.verdict) == (False, "")
    with pytest.raises(RuntimeError):
        addon.ops.rauca.check_python()
    assert not settings.ready
    return settings.verdict


def test_the_check_says_what_is_missing(addon, settings, tmp_path):
    assert not addon.ops.rauca.check_python.poll()
    assert "is not there" in checked(addon, settings, tmp_path / "none")
    assert "is not a Python" in checked(addon, settings, Path("/bin/ls"))
    old = tmp_path / "old-python"
    old.write_text(
        f'#!/bin/sh\nexec "{sys.executable}" -c "import sys; sys.version_info = (3, 9, 2); exec(sys.argv[1])" "$2"\n'
    )
    old.chmod(0o700)
    assert checked(addon, settings, old).startswith("Python 3.9.2 is too old: choose 3.11 or newer")
    bare = a_python(tmp_path / "bare")
    assert "torch is missing: press Make a Python" in checked(addon, settings, bare)
    assert settings.command == f"{bare} -m pip install torch"
    assert addon.ops.rauca.copy_command(command=settings.command) == {"FINISHED"}
    a_package(bare, "torch", "raise ImportError('libtorch.so: cannot open')")
    assert "torch does not load (libtorch.so: cannot open): install it again" in checked(addon, settings, bare)
    a_package(bare, "torch", "import os; os.abort()")
    assert "torch brings" in checked(addon, settings, bare)


def test_the_check_misses_rauca_where_torch_is(addon, settings, tmp_path, monkeypatch):
    monkeypatch.delenv("PYTHONPATH", raising=False)
    python = a_python(tmp_path / "torch-only")
    site = Path(sysconfig.get_paths()["purelib"])
    here = next((python.parent.parent / "lib").glob("python*")) / "site-packages"
    for entry in site.iterdir():
        if "rauca" not in entry.name and entry.suffix != ".pth" and not (here / entry.name).exists():
            (here / entry.name).symlink_to(entry)
    assert "rauca is missing" in checked(addon, settings, python)
    assert settings.command == f"{python} -m pip install rauca"


def test_the_check_leaves_the_window_free_and_lists_detectors(addon, settings):
    settings.python = sys.executable
    assert state(addon.context).words.startswith("Press Check")
    addon.ops.rauca.check_python(wait=False)
    assert state(addon.context).words == "Checking the chosen Python"
    assert not addon.ops.rauca.check_python.poll()
    assert until(lambda: not watch.busy("check")) < 0.1
    watch.tick()
    assert settings.verdict.startswith(("Python 3.", "There are no detectors yet"))
    if settings.ready:
        assert settings.chosen_detectors() == [settings.detectors[0].name]
    settings.python = "/another"
    assert not settings.ready


@pytest.mark.parametrize(
    ("found", "words"),
    [
        ({"speaks": False, "detectors": ["a"]}, "rauca 0.0.1 is older than this extension"),
        ({"speaks": True, "detectors": []}, "press Fetch Detectors"),
        ({"speaks": True, "detectors": ["a"]}, "torch 2 on CPU, rauca 0.0.1 and 1 detectors"),
    ],
)
def test_verdicts_on_raucas_own_state(found, words):
    ready, told, command = verdict(Path(sys.executable), CHECKED | found)
    assert bool(command) != ready
    assert words in told
    assert ready == (found["speaks"] and bool(found["detectors"]))
