"""Step 4: the data set rendered beside the window is the headless pipeline's, whatever happens meanwhile."""

from __future__ import annotations

import os
import signal
from types import SimpleNamespace

import pytest

import blender_addon
from blender_addon import compat
from blender_addon.jobs import pictures, watch
from blender_addon.steps import frames_panel, on_disk
from blender_addon.steps.cameras import timing
from blender_addon.steps.dataset import PICTURE, dataset_job, state
from tests.blender.conftest import refusal
from tests.blender.timer import until
from tests.pipelines.test_headless import MAKE, run
from tests.pipelines.test_jobs import content

SMALL = (
    "--size 64 --samples 1 --no-denoise --seed 3 --vehicle sedan --weathers demo "
    "--azimuths 1 --elevations 17.5 --distances 8"
)


@pytest.fixture(scope="module")
def headless(tmp_path_factory) -> dict[str, bytes]:
    """The same settings on the command line."""
    folder = tmp_path_factory.mktemp("headless") / "set"
    made = run(MAKE, "--out", folder, *SMALL.split())
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
    steps().dataset.folder = str(tmp_path / "set")
    assert state(addon.context).words.startswith("Ready: 3 frames, about ")
    assert addon.ops.rauca.generate_dataset(wait=False) == {"FINISHED"}
    job = watch.job("dataset")
    assert addon.app.timers.is_registered(watch._beat)
    assert not addon.ops.rauca.generate_dataset.poll()
    assert state(addon.context).kind == "running"
    longest = until(lambda: job.done >= 1)
    assert tuple(pictures.shown(PICTURE).image_size) == (64, 64)

    assert addon.ops.rauca.steer_job(job="dataset", action="PAUSE") == {"FINISHED"}
    longest = max(longest, until(lambda: job.phase == "paused"))
    assert not list((tmp_path / "set").rglob(".partial-*"))
    assert 1 <= len(list((tmp_path / "set" / "frames").iterdir())) < job.total
    addon.ops.wm.read_homefile(use_empty=True, load_ui=False)
    assert watch.job("dataset") is job
    assert state(addon.context).words.startswith("Paused: ")  # it is at work, whichever file is open

    assert addon.ops.rauca.steer_job(job="dataset", action="GO_ON") == {"FINISHED"}
    addon.ops.ed.undo_push(message="something")
    longest = max(longest, until(lambda: not job.alive))
    assert job.phase == "done"
    assert state(addon.context).kind == "missing"  # another file's job: this file has no folder yet
    addon.context.scene.rauca.dataset.folder = str(tmp_path / "set")
    assert state(addon.context).words == f"Finished: {job.total} of {job.total} frames"
    watch.forget("dataset")  # as after a restart: what is there is read from the disk
    assert (state(addon.context).kind, state(addon.context).words) == ("done", "3 of 3 frames are there")
    assert not job.task.scratch.exists()
    assert content(tmp_path / "set") == headless
    assert longest < 0.1


def test_a_script_without_a_window_waits_for_the_end(addon, steps, headless, tmp_path):
    settings = steps().dataset
    settings.folder = str(tmp_path / "set")
    assert addon.ops.rauca.generate_dataset() == {"FINISHED"}
    assert content(tmp_path / "set") == headless
    settings.size = 96
    assert "holds a dataset made with another size" in refusal(addon.ops.rauca.generate_dataset)


def test_finished_frames_can_be_leafed_through(addon, steps, headless, tmp_path):
    settings = steps().dataset
    settings.folder = str(tmp_path / "none")
    assert not frames_panel.RAUCA_PT_frames.poll(addon.context)
    for file, data in headless.items():
        (tmp_path / "set" / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "set" / file).write_bytes(data)
    settings.folder, settings.shown = str(tmp_path / "set"), 99  # more than there are: the last
    assert frames_panel.RAUCA_PT_frames.poll(addon.context)
    last = on_disk.finished_frames(settings.folder)[-1]
    drawn = []
    said = {"template_icon": lambda *_, **__: None, "prop": lambda *_: None}
    layout = SimpleNamespace(**said, label=lambda **words: drawn.append(words))
    frames_panel.RAUCA_PT_frames.draw_inside(None, addon.context, layout)
    assert drawn[0]["text"] == f"3 of 3: {last.weather.name}, view {last.view + 1}"
    name = f"browsed.{tmp_path / 'set' / 'frames' / last.id / 'image.png'}"
    assert pictures.shown(name) is not None
    settings.shown = 1
    frames_panel.RAUCA_PT_frames.draw_inside(None, addon.context, layout)
    assert pictures.shown(name) is None  # one at a time is kept


def test_a_part_of_the_frames_is_asked_for(addon, steps, tmp_path):
    settings = steps().dataset
    settings.folder = str(tmp_path / "set")
    for part, frames, asked in ((2, 2, 2), (0, 3, None)):
        settings.part = part
        assert state(addon.context).words.startswith(f"Ready: {frames} frames, about ")
        job = dataset_job(addon.context, tmp_path / "set", tmp_path / "vehicle")
        assert (job.frames and len(job.frames)) == asked


def test_disabling_and_a_death_leave_a_set_that_goes_on_to_the_same_bytes(addon, steps, headless, tmp_path):
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
    assert "killed" in job.ending
    there = len(list((tmp_path / "set" / "frames").glob("L*")))
    assert state(addon.context).words == f"{there} of 3 frames are there"
    assert state(addon.context).kind == ("done" if there == 3 else "ready")

    start()
    until(lambda: not watch.busy("dataset"))
    assert watch.job("dataset").phase == "done"
    assert content(tmp_path / "set") == headless


def test_stopping_at_once_and_when_nothing_runs(addon, steps, tmp_path):
    for action in ("PAUSE", "GO_ON", "STOP"):
        assert "Nothing is " in refusal(addon.ops.rauca.steer_job, job="dataset", action=action)
    steps().dataset.folder = str(tmp_path / "set")
    addon.ops.rauca.generate_dataset(wait=False)
    for _ in range(2):
        addon.ops.rauca.steer_job(job="dataset", action="STOP")
    until(lambda: not watch.busy("dataset"))
    assert watch.job("dataset").phase == "stopped"
    assert addon.ops.rauca.generate_dataset.poll()


def test_a_job_teaches_the_pace_of_the_blenders_it_began_with(addon, steps, tmp_path, monkeypatch):
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
    assert "Choose a folder for the dataset" in refusal(addon.ops.rauca.generate_dataset)
    (tmp_path / "file").write_text("")
    (tmp_path / "holiday").mkdir()
    (tmp_path / "holiday" / "beach.jpg").write_text("")
    refused = {
        "//set": "save it first",
        str(tmp_path / "file"): "is a file, not a folder; choose another",
        str(tmp_path / "file" / "set"): "is a file, not a folder; choose another",
        str(tmp_path / "holiday"): "holds other files and no dataset; choose an empty",
        "/proc/1/set": "not writable; choose another folder for the dataset",  # not even root may write there
    }
    for folder, words in refused.items():
        settings.folder = folder
        assert words in refusal(addon.ops.rauca.generate_dataset)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "holiday"]


def test_a_blender_without_a_denoiser_suggests_samples(addon, steps, tmp_path, monkeypatch):
    addon.context.scene.cycles.denoiser = "OPENIMAGEDENOISE"
    assert compat.has_denoiser()
    monkeypatch.setattr(compat, "has_denoiser", lambda: False)
    settings = steps().dataset
    settings.folder, settings.samples, settings.denoise = str(tmp_path / "set"), 16, True
    assert "without a denoiser; turn Denoise off and take 128 samples" in refusal(addon.ops.rauca.generate_dataset)
    assert addon.ops.rauca.without_denoiser() == {"FINISHED"}
    assert (settings.denoise, settings.samples) == (False, 128)
    assert "Denoise is off already" in refusal(addon.ops.rauca.without_denoiser)
