"""The headless jobs as users run them: real processes, real renders, at thumbnail size."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rauca_core.contract import (
    Camouflage,
    Dataset,
    MakeDataset,
    RaucaError,
    RenderCamouflages,
    chunks,
    load_passes,
    load_vehicle,
    planned_frames,
    save_camouflage,
)
from rauca_core.contract.files import png_bytes
from rauca_core.runtime.blender import run_blender, run_blenders
from rauca_core.runtime.images import read_image

pytest.importorskip("bpy", reason="the bpy wheel is not installed")

from blender_addon import devices
from blender_addon.jobs.dataset_job import _Run

REPOSITORY = Path(__file__).resolve().parent.parent.parent
MAKE = REPOSITORY / "pipelines" / "make_dataset.py"
SMALL = ["--azimuths", "2", "--elevations", "15", "--distances", "6", "--size", "64", "--samples", "2"]


def run(script: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(script), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


def refused(script: Path, *arguments: object) -> str:
    """The one line, without a traceback, with which a job ends that it does not do."""
    done = run(script, *arguments)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    return done.stderr.strip().splitlines()[-1]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory) -> Dataset:
    folder = tmp_path_factory.mktemp("data") / "set"
    done = run(MAKE, "--out", folder, *SMALL)
    assert done.returncode == 0, done.stderr
    return Dataset(folder)


def test_every_planned_frame_is_there_and_whole(dataset):
    frames = dataset.frames()
    assert len(frames) == 2 * 3
    for frame in frames:
        folder = dataset.frame_folder(frame.id)
        assert sorted(p.name for p in folder.iterdir()) == [
            "SHA256SUMS", "frame.json", "image.png", "instances.png", "paint.png", "passes.npz", "semantic.png",
            "vehicle.png",
        ]  # fmt: skip
        passes = load_passes(folder)
        paint, image = read_image(folder / "paint.png"), read_image(folder / "image.png")
        assert image.shape == (64, 64, 3)
        assert passes["A"].shape == (64, 64, 3)
        assert (paint > 127).sum() > 100
        assert passes["A"][paint == 0].max() == 0
        assert passes["A"][paint == 255].mean() > 0.01
        assert frame.box_xyxy is not None
        assert frame.visible > 0.9
    ledger = [json.loads(line) for line in (dataset.folder / "ledger.jsonl").read_text().splitlines()]
    order = [frame.id for frame in next(chunks(dataset.plan, planned_frames(dataset.plan), 100))]
    assert [(entry["frame"], entry["state"]) for entry in ledger] == [(frame_id, "done") for frame_id in order]


def test_weathers_differ_and_share_cameras(dataset):
    by_weather = {f.weather.name: f for f in dataset.frames() if f.view == 0}
    cameras = {json.dumps(f.camera.to_json()) for f in by_weather.values()}
    assert len(cameras) == 1
    images = [read_image(dataset.frame_folder(f.id) / "image.png").astype(int) for f in by_weather.values()]
    assert all(np.abs(a - b).mean() > 3 for i, a in enumerate(images) for b in images[:i])


def test_a_second_run_renders_nothing_and_repairs_what_is_gone(dataset):
    victim = dataset.frame_folder(dataset.frames()[0].id)
    before = (victim / "image.png").read_bytes()
    for path in victim.iterdir():
        path.unlink()
    victim.rmdir()
    lines = len((dataset.folder / "ledger.jsonl").read_text().splitlines())
    assert run(MAKE, "--out", dataset.folder, *SMALL).returncode == 0
    assert len((dataset.folder / "ledger.jsonl").read_text().splitlines()) == lines + 1
    assert (victim / "image.png").read_bytes() == before  # the same seed renders the same bits


def test_a_changed_vehicle_in_the_same_folder_is_refused(dataset, tmp_path):
    """One whose atlas is the same: taller, or of another color; the plan alone cannot tell."""
    given = load_vehicle(dataset.folder / "vehicle", read_image)
    taller = replace(given, positions=given.positions * np.float32([1, 1, 1.5]))
    red = replace(given, materials=[replace(m, base_color=(0.6, 0.0, 0.0)) for m in given.materials])
    for kind, changed in (("positions", taller), ("materials", red)):
        changed.save(tmp_path / kind)
        wanted = f"error: {dataset.folder}: holds a data set of another sedan (changed: {kind}); choose another folder"
        assert refused(MAKE, "--out", dataset.folder, *SMALL, "--vehicle", tmp_path / kind).startswith(wanted)
    given.save(tmp_path / "same")
    assert run(MAKE, "--out", dataset.folder, *SMALL, "--vehicle", tmp_path / "same").returncode == 0


def test_a_vehicle_that_another_shard_wrote_meanwhile_is_refused(tmp_path, box_vehicle):
    box_vehicle.save(tmp_path / "vehicle")
    taller = replace(box_vehicle, positions=box_vehicle.positions * np.float32([1, 1, 1.5]))
    (tmp_path / "dataset.json").write_text("{}")
    run = _Run(MakeDataset(tmp_path, None), taller, tmp_path / "draft", tmp_path / "job", lambda progress: None)
    with pytest.raises(RaucaError, match="holds a data set of another"):
        run._claim(SimpleNamespace(shared_writing=contextlib.nullcontext))
    assert (tmp_path / "dataset.json").read_text() == "{}"


def test_camouflages_are_rendered_on_the_same_views(dataset, tmp_path):
    size, atlas = 64, dataset.plan.atlas_id
    for name, color in (("red", (255, 0, 0)), ("blue", (0, 0, 255))):
        uv_map = np.broadcast_to(np.uint8(color), (size, size, 3)).copy()
        record = Camouflage(name, dataset.plan.vehicle_name, atlas, size, "plain")
        save_camouflage(tmp_path / f"{name}.json", record, png_bytes(uv_map))
    camouflages = [tmp_path / "red.json", tmp_path / "blue.json"]
    job, moves = RenderCamouflages(dataset.folder, tmp_path / "renders", tuple(camouflages)), []
    run_blender(job, moves.append)
    for frame in dataset.frames():
        red, blue = (read_image(tmp_path / "renders" / n / f"{frame.id}.png").astype(int) for n in ("red", "blue"))
        paint = read_image(dataset.frame_folder(frame.id) / "paint.png") == 255
        assert (red - blue)[paint][:, 0].mean() > 15
        assert (blue - red)[paint][:, 2].mean() > 15
    run_blender(job, moves.append)
    assert (moves[-1].done, moves[-1].total) == (12, 12)
    ids = sorted(frame.id for frame in dataset.frames())
    parts = [
        replace(job, out=tmp_path / "two at once", threads=1, frames=part) for part in (tuple(ids[:2]), tuple(ids[2:]))
    ]
    moves.clear()
    run_blenders(parts, moves.append)
    assert (moves[-1].done, moves[-1].total) == (12, 12)
    for path in (tmp_path / "renders").rglob("*.png"):  # neither the thread nor who else renders changes a bit
        assert (tmp_path / "two at once" / path.relative_to(tmp_path / "renders")).read_bytes() == path.read_bytes()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--vehicle", "nowhere.obj"], "nowhere.obj: no such vehicle"),
        (["--weathers", "sunny"], "'sunny' is unknown; choose one of base, carla, demo"),
        (["--fov", "500"], "fov_deg must be between 1 and 170"),
        (["--vehicle", "sedan", "--paint-mask", "x.png"], "brings its own paint"),
    ],
)
def test_mistakes_are_one_line_and_leave_nothing(tmp_path, arguments, message):
    complaint = refused(MAKE, "--out", tmp_path / "set", *SMALL, *arguments)
    assert complaint.startswith("error: ")
    assert message in complaint
    assert not (tmp_path / "set").exists()


def test_a_disk_too_small_is_told_before_anything_is_written(tmp_path):
    enormous = ["--size", "8192", "--azimuths", "360", "--elevations", ",".join(map(str, range(60)))]
    assert "MiB free" in refused(MAKE, "--out", tmp_path / "set", *enormous)
    assert not (tmp_path / "set").exists()


def test_the_device_is_recorded(tmp_path):
    """This machine may have a GPU or none; either way the data set says what rendered it."""
    one = ["--out", tmp_path / "set", *SMALL, "--azimuths", "1", "--weathers", "single", "--size", "32"]
    assert run(MAKE, *one, "--render-device", "auto").returncode == 0
    assert Dataset(tmp_path / "set").plan.device == devices.find("auto").described
