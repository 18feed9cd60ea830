"""Step 4: the data set rendered beside the window is the headless pipeline's, whatever happens meanwhile."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.blender.disks import fill
from tests.blender.timer import until

REPOSITORY = Path(__file__).resolve().parent.parent.parent
SMALL = (
    "--size 64 --samples 1 --no-denoise --seed 3 --vehicle sedan --weathers demo "
    "--azimuths 1 --elevations 17.5 --distances 8"
)


def content(folder: Path) -> dict[str, bytes]:
    """Every file of a data set but its ledger, which tells seconds."""
    files = (path for path in folder.rglob("*") if path.is_file() and not path.name.startswith("ledger"))
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def headless(bpy_module, tmp_path_factory) -> dict[str, bytes]:
    """The same settings on the command line."""
    folder = tmp_path_factory.mktemp("headless") / "set"
    command = [sys.executable, str(REPOSITORY / "pipelines" / "make_dataset.py"), "--out", str(folder)]
    command += SMALL.split()
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
    return content(folder)


@pytest.fixture
def steps(addon):
    """The panels' settings, small; asked for anew after a file was loaded."""

    def ask():
        found = addon.context.scene.rauca
        found.vehicle.origin, found.vehicle.file, found.weather.preset = "FILE", "sedan", "demo"
        found.cameras.azimuths = found.cameras.elevations = found.cameras.distances = 1
        settings = found.dataset
        settings.size, settings.samples, settings.denoise, settings.seed = 64, 1, False, 3
        return found

    return ask


def test_same_bytes_as_headless_across_a_pause_and_a_loaded_file(addon, steps, headless, tmp_path):
    from blender_addon.jobs import pictures, watch
    from blender_addon.steps.dataset import PICTURE, state

    steps().dataset.folder = str(tmp_path / "set")
    assert state(addon.context).words.startswith("Ready: 3 frames, about ")
    assert addon.ops.rauca.generate_dataset(wait=False) == {"FINISHED"}
    job = watch.job("dataset")
    assert addon.app.timers.is_registered(watch._beat)
    assert not addon.ops.rauca.generate_dataset.poll()
    assert state(addon.context).kind == "running"
    longest = until(lambda: job.done >= 1)
    assert tuple(pictures.shown(PICTURE).image_size) == (64, 64)

    assert addon.ops.rauca.pause_job(job="dataset") == {"FINISHED"}
    longest = max(longest, until(lambda: job.phase == "paused"))
    assert not list((tmp_path / "set").rglob(".partial-*"))
    assert 1 <= len(list((tmp_path / "set" / "frames").iterdir())) < job.total
    addon.ops.wm.read_homefile(use_empty=True, load_ui=False)
    assert watch.job("dataset") is job
    assert state(addon.context).words.startswith("Paused: ")

    assert addon.ops.rauca.continue_job(job="dataset") == {"FINISHED"}
    addon.ops.ed.undo_push(message="something")
    longest = max(longest, until(lambda: not job.alive))
    assert job.phase == "done"
    assert state(addon.context).words == f"Finished: {job.total} of {job.total} frames"
    assert not job.task.scratch.exists()
    assert content(tmp_path / "set") == headless
    assert longest < 0.1


def test_a_script_without_a_window_waits_for_the_end(addon, steps, headless, tmp_path):
    settings = steps().dataset
    settings.folder = str(tmp_path / "set")
    assert addon.ops.rauca.generate_dataset() == {"FINISHED"}
    assert content(tmp_path / "set") == headless
    settings.size = 96
    with pytest.raises(RuntimeError, match="holds a dataset made with another size"):
        addon.ops.rauca.generate_dataset()


def test_a_part_of_the_frames_is_asked_for(addon, steps, tmp_path):
    from blender_addon.steps.dataset import dataset_job, state

    settings = steps().dataset
    settings.folder = str(tmp_path / "set")
    for part, frames, asked in ((2, 2, 2), (0, 3, None)):
        settings.part = part
        assert state(addon.context).words.startswith(f"Ready: {frames} frames, about ")
        job = dataset_job(addon.context, tmp_path / "set", tmp_path / "vehicle")
        assert (job.frames and len(job.frames)) == asked


def test_disabling_and_a_death_leave_a_set_that_goes_on_to_the_same_bytes(addon, steps, headless, tmp_path):
    import blender_addon
    from blender_addon.jobs import watch
    from blender_addon.steps.dataset import state

    def start():
        steps().dataset.folder = str(tmp_path / "set")
        assert addon.ops.rauca.generate_dataset(wait=False) == {"FINISHED"}
        return watch.job("dataset")

    job = start()
    until(lambda: job.done >= 1)
    blender_addon.unregister()
    assert watch.job("dataset") is None
    assert not addon.app.timers.is_registered(watch._beat)
    until(lambda: job._process.code() is not None)
    assert job._process.code() == 2
    assert job._process.complaints()[-1].startswith("interrupted: ")
    assert not list((tmp_path / "set").rglob(".partial-*"))
    blender_addon.register()

    job = start()
    before = len(list((tmp_path / "set" / "frames").iterdir()))
    until(lambda: job.done > before)
    os.kill(job.pid, signal.SIGKILL)
    until(lambda: not job.alive)
    assert "killed" in job.ending.text
    assert state(addon.context).kind == "ready"

    start()
    until(lambda: not watch.busy("dataset"))
    assert watch.job("dataset").phase == "done"
    assert content(tmp_path / "set") == headless


def test_a_disk_that_runs_full_is_told_and_what_is_finished_goes_on_elsewhere(
    addon, steps, headless, small_disk, tmp_path
):
    from blender_addon.jobs import watch
    from blender_addon.steps.dataset import state

    def start(folder):
        steps().dataset.folder = str(folder)
        assert addon.ops.rauca.generate_dataset(wait=False) == {"FINISHED"}
        return watch.job("dataset")

    job = start(small_disk / "set")
    until(lambda: job.done >= 1)
    fill(small_disk)
    until(lambda: not job.alive)
    assert job.phase == "failed"
    words = job.ending.text.format(**job.ending.values)
    assert re.search(r"set/frames(/[^.]\S*)?: no space left on the disk; free some and start again$", words), words
    assert state(addon.context).kind == "ready"
    left = [p.name for p in (small_disk / "set" / "frames").iterdir()]
    assert len(left) == job.done < job.total
    assert not any(name.startswith(".") for name in left)

    shutil.copytree(small_disk / "set", tmp_path / "set")
    start(tmp_path / "set")
    until(lambda: not watch.busy("dataset"))
    assert content(tmp_path / "set") == headless


def test_stopping_at_once_and_when_nothing_runs(addon, steps, tmp_path):
    from blender_addon.jobs import watch

    for operator in ("pause_job", "continue_job", "stop_job"):
        with pytest.raises(RuntimeError, match=r"Nothing is (running|paused)"):
            getattr(addon.ops.rauca, operator)(job="dataset")
    steps().dataset.folder = str(tmp_path / "set")
    addon.ops.rauca.generate_dataset(wait=False)
    for _ in range(2):
        addon.ops.rauca.stop_job(job="dataset")
    until(lambda: not watch.busy("dataset"))
    assert watch.job("dataset").phase == "stopped"
    assert addon.ops.rauca.generate_dataset.poll()


def test_a_job_teaches_the_pace_of_the_blenders_it_began_with(addon, steps, tmp_path, monkeypatch):
    from blender_addon.jobs import watch
    from blender_addon.steps.cameras import timing

    learned, after = [], []
    monkeypatch.setattr(timing, "learn", lambda folder, workers: learned.append((folder, workers)))
    monkeypatch.setattr(watch, "begin", lambda name, task, done: after.append(done))
    settings = steps().dataset
    settings.folder, settings.workers = str(tmp_path / "set"), 4
    addon.ops.rauca.generate_dataset(wait=False)
    settings.workers = 1  # of the next job
    after[0](None)
    assert learned == [(tmp_path / "set", 4)]


def test_folders_that_cannot_be_used(addon, steps, tmp_path):
    settings = steps().dataset
    with pytest.raises(RuntimeError, match="Choose a folder for the dataset"):
        addon.ops.rauca.generate_dataset()
    (tmp_path / "file").write_text("")
    (tmp_path / "holiday").mkdir()
    (tmp_path / "holiday" / "beach.jpg").write_text("")
    refused = {
        "//set": "save it first",
        str(tmp_path / "file"): "is a file, not a folder; choose another",
        str(tmp_path / "file" / "set"): "is a file, not a folder; choose another",
        str(tmp_path / "holiday"): "holds other files and no dataset; choose an empty",
    }
    for folder, words in refused.items():
        settings.folder = folder
        with pytest.raises(RuntimeError, match=words):
            addon.ops.rauca.generate_dataset()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "holiday"]


def test_a_folder_without_permission(addon, steps, tmp_path):
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o500)
    where = closed if not os.access(closed, os.W_OK) else Path("/proc/1")  # root may write anywhere but there
    if os.access(where, os.W_OK):
        pytest.skip("this user may write everywhere")
    steps().dataset.folder = str(where / "set")
    with pytest.raises(RuntimeError, match="not writable; choose another folder for the dataset"):
        addon.ops.rauca.generate_dataset()


def test_what_the_child_refuses_is_told(addon, steps, tmp_path):
    settings = steps().dataset
    settings.folder, settings.size, settings.locations = str(tmp_path / "set"), 4096, 100
    addon.context.scene.rauca.cameras.azimuths = 360
    free = os.statvfs(tmp_path)
    if free.f_bavail * free.f_frsize > 4096**2 * 24 * 360 * 100 * 3:
        pytest.skip("this disk is large enough for it")
    with pytest.raises(RuntimeError, match="free some space or choose another folder"):
        addon.ops.rauca.generate_dataset()


def test_a_blender_without_a_denoiser_suggests_samples(addon, steps, tmp_path, monkeypatch):
    from blender_addon import compat

    assert compat.denoiser_is_built_in() == compat.has_denoiser(addon.context.scene)
    monkeypatch.setattr(compat, "denoiser_is_built_in", lambda: False)
    settings = steps().dataset
    settings.folder, settings.samples, settings.denoise = str(tmp_path / "set"), 16, True
    with pytest.raises(RuntimeError, match="without a denoiser; turn Denoise off and take 128 samples"):
        addon.ops.rauca.generate_dataset()
    assert addon.ops.rauca.without_denoiser() == {"FINISHED"}
    assert (settings.denoise, settings.samples) == (False, 128)
    with pytest.raises(RuntimeError, match="Denoise is off already"):
        addon.ops.rauca.without_denoiser()
