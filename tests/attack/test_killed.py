"""Killed runs end in the bits of one that was left alone; NaN stops a run by the frame's name."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rauca_core.attack import DetectorEnsemble, make_settings, read_history, run_optimization
from rauca_core.attack.history import PICTURE, UV_MAP
from rauca_core.attack.run import Run
from rauca_core.contract import Dataset, FramePasses, RaucaError, load_frame, save_frame
from rauca_core.contract.files import TEMPORARY_PREFIX
from rauca_core.detect.interface import check_images
from rauca_core.runtime.images import read_image
from rauca_core.runtime.tensor_files import CHECKPOINTS, load_checkpoint

SETTINGS = {"steps": 9, "batch": 2, "map_size": 32, "samples": 2, "checkpoint_every": 2, "lr": 0.03, "rest": 1}

# A process that starts the run again and again, each time in a child that dies as it is about to change a file: at the
# first or second change of that kind. Where a line is appended, half of it is written first.
KILLED = """
import json, os, shutil, signal, sys, torch
from pathlib import Path
from benchmarks.stability.detectors import SmallDetector
from rauca_core.attack import make_settings, run_optimization
from rauca_core.contract import Dataset

torch.set_num_threads(1)
data, out, chosen = Dataset(Path(sys.argv[1])), Path(sys.argv[2]), make_settings(**json.loads(sys.argv[3]))
run_optimization(data, [SmallDetector()], chosen, out / "whole")  # first, so that children find their kernels loaded
shutil.rmtree(data.folder / "taps")
out = out / "killed"

def die_at(kind, named, time):
    change, seen = getattr(os, kind), 0
    def call(*given, **more):
        nonlocal seen
        seen += named in " ".join(Path(g).name for g in given if isinstance(g, (str, Path)))
        if seen == time:
            if kind == "write":
                change(given[0], given[1][: len(given[1]) // 2])
            os.kill(os.getpid(), signal.SIGKILL)
        return change(*given, **more)
    setattr(os, kind, call)

for moment in [*json.loads(sys.argv[4]), None]:
    child = os.fork()
    if child == 0:
        if moment is not None:
            die_at(*moment)
        run_optimization(data, [SmallDetector()], chosen, out)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    assert status == (0 if moment is None else signal.SIGKILL), (moment, status)
"""
MOMENTS = [
    ("replace", ".safetensors", 1),  # taps
    ("replace", "preview.png", 1),
    ("replace", "step-", 1),  # the first checkpoint, of step 2
    ("replace", "checkpoint.json", 1),
    ("replace", "checkpoint.json", 2),  # that of step 2 stands
    ("write", "", 1),  # a line of the history
    ("unlink", "step-", 1),  # of the old tensors: the new checkpoint stands
    ("replace", "step-", 2),
    ("write", "", 2),
    ("fsync", "", 2),
    ("replace", "camouflage.png", 1),
    ("replace", "camouflage.json", 1),
]


def test_killed_at_every_kind_of_change_of_a_file(dataset: Dataset, tmp_path: Path) -> None:
    out = tmp_path / "killed"
    command = [
        sys.executable,
        "-c",
        KILLED,
        str(dataset.folder),
        str(tmp_path),
        json.dumps(SETTINGS),
        json.dumps(MOMENTS),
    ]
    told = subprocess.run(
        command, cwd=Path(__file__).parents[2], capture_output=True, text=True, timeout=600, check=False
    )
    assert told.returncode == 0, told.stderr
    one, two = (load_checkpoint(folder / CHECKPOINTS) for folder in (tmp_path / "whole", out))
    assert set(one.tensors) == set(two.tensors)
    assert all(torch.equal(one.tensors[name], two.tensors[name]) for name in one.tensors)
    assert (out / "camouflage.png").read_bytes() == (tmp_path / "whole" / "camouflage.png").read_bytes()
    kept = [[(h["step"], h["loss"], h["score"]) for h in read_history(f)] for f in (tmp_path / "whole", out)]
    assert kept[0] == kept[1]
    assert not list(out.rglob(TEMPORARY_PREFIX + "*"))
    assert read_image(out / UV_MAP).shape == (32, 32, 3)
    assert read_image(out / PICTURE).shape == (32, 64, 3)


SHORT = make_settings(steps=8, batch=2, map_size=32, samples=2, checkpoint_every=1, memory_mb=64)


def poison(dataset: Dataset, frame_id: str) -> None:
    """Light maps that are NaN in one pixel, as a renderer's bug leaves them."""
    folder = dataset.frame_folder(frame_id)
    stored = np.load(folder / "passes.npz")
    A, B = stored["A"].astype(np.float32), stored["B"].astype(np.float32)
    A[10, 20, 1] = np.nan
    flat = np.zeros(A.shape[:2], np.float32)
    save_frame(folder, load_frame(folder), FramePasses(np.zeros_like(A), flat, flat, flat, A, B))


def test_a_poisoned_frame_stops_the_run_and_a_mended_one_goes_on(
    dataset: Dataset, small_detector: Any, tmp_path: Path
) -> None:
    run_optimization(dataset, [small_detector], SHORT, tmp_path / "whole")
    fresh = Run(dataset, DetectorEnsemble([small_detector], "car"), SHORT)
    bad = fresh.store.frames[fresh.order.upcoming()[5]].id  # of the third step
    fresh.close()
    folder, out = dataset.frame_folder(bad), tmp_path / "out"
    shutil.copytree(folder, tmp_path / "good")
    poison(dataset, bad)
    with pytest.raises(RaucaError, match=f"{bad}/passes.npz: A holds NaN or infinity; .*render it again"):
        run_optimization(dataset, [small_detector], SHORT, out)
    kept = load_checkpoint(out / CHECKPOINTS)
    assert 0 < kept.step < 3
    assert all(torch.isfinite(tensor).all() for tensor in kept.tensors.values())
    assert [line["step"] for line in read_history(out)] == list(range(1, kept.step + 1))
    assert not (out / "camouflage.json").exists()
    assert not (out / "camouflage.png").exists()
    assert not list(out.rglob(TEMPORARY_PREFIX + "*"))

    shutil.rmtree(folder)
    shutil.copytree(tmp_path / "good", folder)
    run_optimization(dataset, [small_detector], SHORT, out)
    assert (out / "camouflage.png").read_bytes() == (tmp_path / "whole" / "camouflage.png").read_bytes()


def test_light_that_turns_nan_on_the_way_is_named_though_the_detector_sees_it_first(
    dataset: Dataset, small_detector: Any
) -> None:
    """Estimated light is not read from a file that could be checked; real detectors refuse the picture, unnamed."""
    dense = small_detector.dense
    small_detector.dense = lambda images: (check_images("small", images), dense(images))[1]
    run = Run(dataset, DetectorEnsemble([small_detector], "car"), SHORT)
    bad, source = run.store.frames[run.order.upcoming()[1]].id, run.store.light

    def of(frame: Any) -> Any:
        light, image = source.of(frame)
        return (replace(light, A=light.A * np.float32(np.nan)) if frame.id == bad else light), image

    run.store.light = replace(source, of=of)
    before = run.texture.texels().detach().clone()
    try:
        with pytest.raises(RaucaError, match=f"step 1: the picture of frame {bad} is not finite"):
            run.advance()
    finally:
        run.close()
    assert torch.equal(run.texture.texels(), before)
