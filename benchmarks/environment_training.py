"""Extractors trained on the benchmark's own data: what training costs, and what pre-training saves."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pipelines.console import progress_bar
from rauca_core.contract import Progress
from rauca_core.contract.color import TEST
from rauca_core.contract.seeding import named_seed
from rauca_core.environment import LightSplitter, PublishedEfe, load_extractor
from rauca_core.environment.frames import LightFrames
from rauca_core.environment.methods import splitter_render
from rauca_core.environment.metrics import measure, total
from rauca_core.training.extractor import EpochReport, Job, Outcome, smoothed, train
from rauca_core.training.extractor_learners import FinalLearner, Item, Learner, PublishedLearner, SplitterLearner
from rauca_core.training.settings import ExtractorSettings

from .harness import Row, Settings

OURS = {"batch": 4, "lr": 4e-3, "crop": 80, "stop_early": False}
PUBLISHED = {"batch": 4, "lr": 0.01, "stop_early": False, "method": "published-final"}
FINE_TUNED: dict[str, Any] = {"lr": 1e-3, "schedule": "constant", "crop": 80, "mixed": False}
NEAR = 1.05  # times the least error from scratch


@dataclass(frozen=True, eq=False)
class Trained:
    """A network with the weights of its best epoch."""

    net: Any
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
    torch.manual_seed(named_seed(seed, "weights"))
    return LightSplitter()


def train_ours(
    frames: LightFrames, train_on: Sequence[int], test_on: Sequence[int], net: LightSplitter, title: str, **chosen: Any
) -> Trained:
    settings = ExtractorSettings.make(**(OURS | chosen))
    return _train(SplitterLearner(net, frames, settings), frames, train_on, test_on, settings, title)


def train_published(
    frames: LightFrames, train_on: Sequence[int], test_on: Sequence[int], settings: Settings, title: str
) -> Trained:
    """Train the published extractor by its final loop, as published: Adam 0.01, BCE with W."""
    torch.manual_seed(named_seed(0, "published weights"))
    chosen = ExtractorSettings.make(**(PUBLISHED | {"epochs": settings.published_epochs}))
    learner = FinalLearner(PublishedEfe(settings.widths), frames, chosen)
    return _train(learner, frames, train_on, test_on, chosen, title)


def _train(
    learner: Learner,
    frames: LightFrames,
    train_on: Sequence[int],
    test_on: Sequence[int],
    settings: ExtractorSettings,
    title: str,
) -> Trained:
    best: dict[str, torch.Tensor] = {}

    def keep(epoch: int, net: torch.nn.Module, errors: object) -> None:
        best.update({name: value.clone() for name, value in net.state_dict().items()})

    started = time.process_time()
    with tempfile.TemporaryDirectory(prefix="rauca-bench-") as folder, progress_bar(title, resumes=False) as move:

        def show(report: EpochReport) -> None:
            move(Progress(report.epoch, report.epochs, f"error {report.error:.4f}"))

        job = Job(learner, frames, train_on, test_on, settings, Path(folder), keep)
        outcome = train(job, on_epoch=show)
    learner.net.load_state_dict(best)
    return Trained(learner.net.eval(), outcome, time.process_time() - started)


class BaseLearner(PublishedLearner):
    """The loop of the paper's base version: every color of every frame is rendered online and inferred anew."""

    def items(self, frames: Sequence[int]) -> list[Item]:
        return [Item(i, color) for i in frames for color in range(len(self._albedos))]

    def loss(self, net: torch.nn.Module, items: Sequence[Item], draw: object) -> torch.Tensor:
        batch, colors = self._batch(items), [item.color for item in items]
        rendered = [self._frames.render_plain(i.frame).x_nr(self._colors_srgb[i.color]) for i in items]
        A, B = net(batch.image * batch.vehicle)
        return self._against_truth(rendered, A, B, batch, self._albedos[colors])


def time_epochs(frames: LightFrames, train_on: Sequence[int], settings: Settings) -> Row:
    """CPU seconds of one epoch of every loop over the same few frames, after one step that is not counted."""
    some = list(train_on)[: settings.timed_frames]
    published, chosen = PublishedEfe(settings.widths), ExtractorSettings.make(**PUBLISHED)
    loops: dict[str, Learner] = {
        "base_s": BaseLearner(published, frames, chosen),
        "final_s": FinalLearner(published, frames, chosen),
        "ours_s": SplitterLearner(LightSplitter(), frames, ExtractorSettings.make(**OURS)),
    }
    return {"frames": len(some), **{name: _time_epoch(loop, some) for name, loop in loops.items()}}


def _time_epoch(learner: Learner, frames: Sequence[int]) -> float:
    optimizer = torch.optim.AdamW(learner.net.parameters(), lr=1e-4)
    items = learner.items(frames)

    def step(part: Any) -> None:
        optimizer.zero_grad()
        learner.loss(learner.net, part, lambda item: np.random.default_rng(item.frame)).backward()
        optimizer.step()

    learner.net.train()
    step(items[:1])
    started = time.process_time()
    for first in range(0, len(items), 4):
        step(items[first : first + 4])
    return time.process_time() - started


def adapt(vehicle: str, frames: LightFrames, unseen: LightFrames, settings: Settings, weights: Path | None) -> Row:
    """Train twice on one unseen vehicle by the same settings, from scratch and from pre-trained weights.

    Returns ``epochs_*`` to the paper's criterion, the most that were tried if it was not met; ``near_*`` to an error
    within 5 % of the least from scratch, ``epochs_matched`` from scratch to the pre-trained's error at convergence,
    None if never; ``mae_*``, least test errors; ``*_db`` on unseen weather, before and after fine-tuning.
    """
    train_on, test_on = frames.split("location", 1 / settings.vehicle_locations)
    pretrained, _ = load_extractor(weights)
    before = splitter_db(pretrained, unseen, range(len(unseen)))
    chosen = FINE_TUNED | {"epochs": settings.most_epochs}
    scratch = train_ours(frames, train_on, test_on, drawn(), f"{vehicle} from scratch", **chosen)
    tuned = train_ours(frames, train_on, test_on, pretrained, f"{vehicle} pre-trained", **chosen)
    errors, better = scratch.outcome.errors, tuned.outcome.errors
    converged = tuned.outcome.converged or settings.most_epochs
    return {
        "vehicle": vehicle,
        "epochs_scratch": scratch.outcome.converged or settings.most_epochs,
        "epochs_pretrained": converged,
        "near_scratch": first_within(errors, NEAR * min(errors)),
        "near_pretrained": first_within(better, NEAR * min(errors)),
        "epochs_matched": first_within(smoothed(errors), smoothed(better)[converged]),
        "mae_scratch": min(errors),
        "mae_pretrained": min(better),
        "before_db": before,
        "after_db": splitter_db(tuned.net, unseen, range(len(unseen))),
    }


def first_within(errors: Sequence[float], most: float) -> int | None:
    """The first epoch whose error is at most ``most``."""
    return next((epoch for epoch, error in enumerate(errors) if error <= most), None)


def splitter_db(net: LightSplitter, frames: LightFrames, part: Sequence[int]) -> float:
    """PSNR in 32 colors against exact maps."""
    return total(measure(frames, part, lambda i, frame: splitter_render(net, frame), TEST).values()).psnr_db
