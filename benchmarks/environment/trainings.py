"""Extractors trained on the benchmark's own data, and what training costs."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from pipelines.console import progress_bar
from rauca_core.contract import Progress
from rauca_core.contract.seeding import named_seed
from rauca_core.environment import LightSplitter, PublishedEfe, TrainingSettings, make_training_settings
from rauca_core.environment.frames import LightFrames
from rauca_core.environment.learner import Learner, SplitterLearner
from rauca_core.environment.published_training import BaseLearner, FinalLearner
from rauca_core.environment.training import EpochReport, Job, Outcome, train
from rauca_core.runtime.distributed import SINGLE_PROCESS

from .neural_renderer import seconds_per_image
from .settings import Settings

OURS = {"batch": 4, "lr": 4e-3, "crop": 80, "stop_early": False}
PUBLISHED = {"batch": 4, "lr": 0.01, "stop_early": False, "method": "published-final"}


@dataclass(frozen=True, eq=False)
class Trained:
    """A network with the weights of its best epoch, and what they cost.

    Attributes:
        net: ready to infer.
        outcome: of the training.
        cpu_seconds: of the training, tests included.
    """

    net: nn.Module
    outcome: Outcome
    cpu_seconds: float

    def to_json(self) -> dict[str, Any]:
        return {
            "epochs": len(self.outcome.errors) - 1,
            "best_epoch": self.outcome.best_epoch,
            "converged": self.outcome.converged,
            "cpu_seconds": round(self.cpu_seconds, 1),
            "parameters": sum(p.numel() for p in self.net.parameters()),
            "mae": [round(e, 5) for e in self.outcome.errors],
        }


def drawn(seed: int = 0) -> LightSplitter:
    """Our network before any training."""
    torch.manual_seed(named_seed(seed, "weights"))
    return LightSplitter()


def train_ours(
    frames: LightFrames, train_on: Sequence[int], test_on: Sequence[int], net: LightSplitter, title: str, **chosen: Any
) -> Trained:
    """Train our extractor; ``chosen`` are settings that differ from the benchmark's."""
    settings = make_training_settings(**(OURS | chosen))
    return _train(SplitterLearner(net, frames, settings), frames, train_on, test_on, settings, title)


def train_published(
    frames: LightFrames, train_on: Sequence[int], test_on: Sequence[int], settings: Settings, title: str
) -> Trained:
    """Train the published extractor by its final loop, as published: Adam 0.01, BCE with W."""
    torch.manual_seed(named_seed(0, "published weights"))
    chosen = make_training_settings(**(PUBLISHED | {"epochs": settings.published_epochs}))
    learner = FinalLearner(PublishedEfe(settings.widths), frames, chosen)
    return _train(learner, frames, train_on, test_on, chosen, title)


def _train(
    learner: Learner,
    frames: LightFrames,
    train_on: Sequence[int],
    test_on: Sequence[int],
    settings: TrainingSettings,
    title: str,
) -> Trained:
    best: dict[str, torch.Tensor] = {}

    def keep(epoch: int, errors: object) -> None:
        best.update({name: value.clone() for name, value in learner.net.state_dict().items()})

    started = time.process_time()
    with tempfile.TemporaryDirectory(prefix="rauca-bench-") as folder, progress_bar(title, resumes=False) as move:

        def show(report: EpochReport) -> None:
            move(Progress(report.epoch, report.epochs, f"error {report.error:.4f}"))

        job = Job(learner, frames, train_on, test_on, settings, Path(folder), keep)
        outcome = train(job, SINGLE_PROCESS, on_epoch=show)
    learner.net.load_state_dict(best)
    return Trained(learner.net.eval(), outcome, time.process_time() - started)


@dataclass(frozen=True)
class EpochTimes:
    """CPU seconds of one epoch over the same few frames.

    ``base`` renders with our rasterizer, ``base_published`` as Neural Renderer does, every pixel against every face.
    """

    frames: int
    base: float
    final: float
    ours: float
    base_published: float

    def to_json(self) -> dict[str, float]:
        return {
            "frames": self.frames,
            "base_s": round(self.base, 3),
            "final_s": round(self.final, 3),
            "ours_s": round(self.ours, 3),
            "base_published_s": round(self.base_published, 1),
        }


def time_epochs(frames: LightFrames, train_on: Sequence[int], settings: Settings) -> EpochTimes:
    """Train one epoch of every loop on the same frames, after one step that is not counted."""
    some = list(train_on)[: settings.timed_frames]
    published = PublishedEfe(settings.widths)
    chosen = make_training_settings(**PUBLISHED)
    learners: list[Learner] = [
        BaseLearner(published, frames, chosen),
        FinalLearner(published, frames, chosen),
        SplitterLearner(LightSplitter(), frames, make_training_settings(**OURS)),
    ]
    base, final, ours = (_time_epoch(learner, some) for learner in learners)
    started = time.process_time()
    frames.render_plain(some[0])
    rendering = time.process_time() - started
    slower = seconds_per_image(frames.vehicle(some[0]), frames.camera(some[0])) - rendering
    return EpochTimes(len(some), base, final, ours, base + len(learners[0].items(some)) * slower)


def _time_epoch(learner: Learner, frames: Sequence[int]) -> float:
    optimizer = torch.optim.AdamW(learner.net.parameters(), lr=1e-4)
    items = learner.items(frames)
    batch = 4

    def step(part: Any) -> None:
        optimizer.zero_grad()
        learner.loss(learner.net, part, lambda item: np.random.default_rng(item.frame)).backward()
        optimizer.step()

    learner.net.train()
    step(items[:1])
    started = time.process_time()
    for first in range(0, len(items), batch):
        step(items[first : first + batch])
    return time.process_time() - started
