"""The loop on drawn data: it learns, stops, resumes after a kill to the same bits, and names what is wrong."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from benchmarks.environment_training import BaseLearner
from rauca_core.contract import RaucaError
from rauca_core.environment import LightSplitter, PublishedEfe
from rauca_core.environment.frames import LightFrames
from rauca_core.runtime.distributed import Processes, joined_processes
from rauca_core.training.extractor import Job, Outcome, train
from rauca_core.training.extractor_learners import FinalLearner, SplitterLearner
from rauca_core.training.loop import AveragedCopy
from rauca_core.training.settings import ExtractorSettings
from tests.pretend_device import DEVICE, PretendDevice

COLORS = ((255, 0, 0), (0, 0, 0), (255, 255, 255))
TINY = {"epochs": 3, "batch": 2, "lr": 5e-3, "threads": 1, "stop_early": False}


def job(folder: Path, out: Path, **chosen) -> Job:
    settings = ExtractorSettings.make(**(TINY | chosen))
    frames = LightFrames([folder])
    torch.manual_seed(7)
    if settings.method == "ours":
        learner = SplitterLearner(LightSplitter((8, 8), 4), frames, settings)
    else:
        learner = FinalLearner(PublishedEfe((4, 6)), frames, settings, COLORS)
    return Job(learner, frames, *frames.split("location"), settings, out)


def run(work: Job, **callbacks) -> Outcome:
    with joined_processes() as alone:
        return train(work, alone, **callbacks)


def weights(work: Job) -> torch.Tensor:
    return torch.cat([p.detach().flatten() for p in work.learner.net.parameters()])


@pytest.mark.parametrize("method", ["ours", "published-final"])
def test_every_loop_learns(dataset, tmp_path, method):
    work = job(dataset.folder, tmp_path / "run", method=method, epochs=8, lr=0.01)
    seen = []
    outcome = run(work, on_epoch=seen.append)
    assert outcome.errors[outcome.best_epoch] < 0.85 * outcome.errors[0]
    assert [report.epoch for report in seen] == list(range(9))
    assert len((tmp_path / "run" / "rounds.jsonl").read_text().splitlines()) == 9
    assert list((tmp_path / "run" / "tensorboard").iterdir())


def test_the_base_loop_infers_once_per_color(dataset, tmp_path):
    final = job(dataset.folder, tmp_path, method="published-final")
    base = BaseLearner(final.learner.net, final.frames, final.settings, COLORS)
    assert len(base.items(final.train)) == len(COLORS) * len(final.learner.items(final.train))
    # One item of each color has, together, the loss of the shared inference: the loops differ in cost alone.
    index, net = final.train[0], final.learner.net.eval()
    apart = torch.stack([base.loss(net, [item], None) for item in base.items([index])]).mean()
    together = final.learner.loss(net, final.learner.items([index]), None)
    assert torch.allclose(apart, together)


CHILD = """
import sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from test_training import job, run
kept = job(Path({data!r}), Path({out!r}), epochs=4, schedule="constant")
run(kept)
# A thread of gloo that outlives the group aborts the process, one time in a hundred, as Python ends.
threads = [(thread / "comm").read_text() for thread in Path("/proc/self/task").iterdir()]
assert not [name for name in threads if "gloo" in name], threads
"""


def child(dataset, out, **environment) -> subprocess.Popen:
    code = CHILD.format(tests=str(Path(__file__).parent), data=str(dataset.folder), out=str(out))
    return subprocess.Popen([sys.executable, "-c", code], env=os.environ | environment)


def test_a_killed_run_ends_in_the_same_bits(dataset, tmp_path):
    process = child(dataset, tmp_path / "killed")
    pointer = tmp_path / "killed" / "checkpoints" / "checkpoint.json"
    while process.poll() is None and not (pointer.is_file() and json.loads(pointer.read_text())["step"] >= 3):
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    whole = job(dataset.folder, tmp_path / "whole", epochs=4, schedule="constant")
    rest = job(dataset.folder, tmp_path / "killed", epochs=4, schedule="constant")
    assert run(rest).errors == run(whole).errors
    assert torch.equal(weights(whole), weights(rest))


def test_two_processes_end_where_one_does(dataset, tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    common = {"WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port}
    pair = [child(dataset, tmp_path / "pair", RANK=str(r), LOCAL_RANK=str(r), **common) for r in range(2)]
    assert [p.wait(timeout=120) for p in pair] == [0, 0]
    alone = job(dataset.folder, tmp_path / "alone", epochs=4, schedule="constant")
    errors = run(alone).errors
    identity = json.loads((tmp_path / "pair" / "checkpoints" / "checkpoint.json").read_text())["identity"]
    assert identity["processes"] == 2
    lines = (tmp_path / "pair" / "rounds.jsonl").read_text().splitlines()
    assert [json.loads(line)["mae"] for line in lines] == pytest.approx(errors, abs=1e-4)
    (tensors,) = (tmp_path / "pair" / "checkpoints").glob("*.safetensors")
    state = load_file(tensors)
    together = torch.cat([state[f"net.{n}"].flatten() for n, _ in alone.learner.net.named_parameters()])
    assert (together - weights(alone)).abs().max() < 1e-3


@pytest.mark.parametrize("method", ["ours", "published-final"])
def test_on_a_device_a_training_ends_as_on_the_cpu(dataset, tmp_path, method):
    here = job(dataset.folder, tmp_path / "here", method=method, epochs=1)
    errors = train(here).errors
    with PretendDevice():
        there = job(dataset.folder, tmp_path / "there", method=method, epochs=1)
        assert train(there, Processes(0, 1, DEVICE)).errors == pytest.approx(errors, abs=1e-4)
        assert {p.device for p in there.learner.net.parameters()} == {DEVICE}
        far = weights(there).cpu()
    assert (far - weights(here)).abs().max() < 1e-3


def test_the_best_weights_are_kept(dataset, tmp_path):
    kept = []
    work = job(dataset.folder, tmp_path / "run", epochs=4)
    outcome = run(Job(**{**vars(work), "keep": lambda epoch, net, errors: kept.append((epoch, set(errors)))}))
    assert kept[-1] == (outcome.best_epoch, {"clear", "fog"})
    assert outcome.errors[outcome.best_epoch] == min(outcome.errors)


def test_what_is_tested_is_the_weights_mean():
    net = torch.nn.Linear(2, 1, bias=False)
    torch.nn.init.zeros_(net.weight)
    mean, nothing = AveragedCopy(net, 0.9), AveragedCopy(net, 0.0)
    for step in range(1, 4):
        torch.nn.init.constant_(net.weight, float(step))
        mean.update(step)
        nothing.update(step)
    assert 1.5 < float(mean.network.weight[0, 0]) < 3
    assert torch.equal(nothing.network.weight, net.weight)


def test_near_and_far_are_mixed(dataset, tmp_path):
    work = job(dataset.folder, tmp_path / "run", crop=16, mixed=True)
    seen = [
        work.learner._draw(item, np.random.default_rng(k))[0] for k in range(8) for item in [work.learner.items([0])[0]]
    ]
    assert {tuple(batch.image.shape[-2:]) for batch in seen} == {(16, 16)}
    painted = [float(batch.paint.sum()) for batch in seen]
    assert max(painted) > 2 * min(painted)


@pytest.mark.parametrize("side", [0, 12, 80])
def test_frames_that_cannot_be_mixed_are_refused(dataset, tmp_path, side):
    with pytest.raises(RaucaError, match=f"^--mixed: frames of 32 pixels, no multiple of --crop {side}; choose"):
        job(dataset.folder, tmp_path / "run", crop=side, mixed=True)


def test_bfloat16_learns_too(dataset, tmp_path):
    outcome = run(job(dataset.folder, tmp_path / "run", epochs=6, lr=0.01, precision="bfloat16"))
    assert min(outcome.errors) < 0.9 * outcome.errors[0]


def test_a_flat_run_stops_early(dataset, tmp_path):
    work = job(dataset.folder, tmp_path / "run", lr=1e-9, epochs=40, stop_early=True, schedule="constant")
    outcome = run(work)
    assert outcome.converged == 5
    assert len(outcome.errors) == 6


def test_a_loss_that_is_not_finite_names_the_frame(dataset, tmp_path):
    work = job(dataset.folder, tmp_path / "run", augment=False)
    broken = work.train[1]
    work.frames.get(broken).A[:] = float("inf")
    with pytest.raises(RaucaError, match=work.frames.places[broken].frame.id):
        run(work)


def test_mistakes_are_named(dataset, tmp_path):
    work = job(dataset.folder, tmp_path / "run", epochs=1)
    run(work)
    with pytest.raises(RaucaError, match="another seed"):
        run(job(dataset.folder, tmp_path / "run", epochs=1, seed=5))
    with pytest.raises(RaucaError, match="batch: "):
        ExtractorSettings.make(batch=0)
    with pytest.raises(RaucaError, match=r"^weight_decay: .*finite number, not inf"):
        ExtractorSettings.make(weight_decay=float("inf"))
    with pytest.raises(RaucaError, match="method: "):
        ExtractorSettings.make(method="theirs")


def test_published_loops_take_the_published_settings():
    published = ExtractorSettings.make(method="published-final", epochs=None)
    assert (published.lr, published.batch, published.weight_decay, published.schedule) == (0.01, 16, 0.0, "constant")
    assert ExtractorSettings.make(method="published-final", lr=0.1).lr == 0.1
