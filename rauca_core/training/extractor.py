"""Training an environment feature extractor: what a step is shown, the test of an epoch, and when to stop.

The paper's criterion (its Section IV, on pre-trained extractors): S_i is the mean absolute error on the test set after
epoch i, ``MS_i = gamma * S_{i-1} + (1 - gamma) * S_i`` smooths it, and epoch i is converged if "the difference between
the loss over the previous five epochs and that at epoch i is within" eta. We read: ``|MS_j - MS_i| <= eta`` for every j
of the five epochs before i. Epoch 0 is the start, before any step; MS_0 = S_0. The first epoch that can pass is thus
the fifth, which is the smallest figure the paper reports.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from ..contract import RaucaError
from ..contract.color import TEST
from ..contract.seeding import named_rng
from ..environment.frames import LightFrames
from ..environment.metrics import Error, measure, total
from ..runtime.board import Board
from ..runtime.distributed import SINGLE_PROCESS, Processes
from ..runtime.tensor_files import started
from .extractor_learners import Item, Learner
from .loop import AveragedCopy, RoundReport, Run, Task, read_ledger, run_task
from .settings import ExtractorSettings

WINDOW = 5  # epochs
GAMMA = 0.5  # what the epoch before counts in a smoothed error


def smoothed(errors: Sequence[float]) -> list[float]:
    """MS_i of S_i, i from 0."""
    return [s if i == 0 else GAMMA * errors[i - 1] + (1 - GAMMA) * s for i, s in enumerate(errors)]


def converged_epoch(errors: Sequence[float], eta: float = 0.003) -> int | None:
    """The first converged epoch of test errors S_0, S_1, ... (mean absolute, sRGB values in [0, 1]), or None."""
    smooth = smoothed(errors)
    for i in range(WINDOW, len(smooth)):
        if all(abs(before - smooth[i]) <= eta for before in smooth[i - WINDOW : i]):
            return i
    return None


@dataclass(frozen=True)
class EpochReport:
    """An epoch and its test.

    Attributes:
        epoch: counted from 1; 0 is the test before the first step.
        epochs: at most.
        error: mean absolute test error, sRGB values.
        best: the least so far.
        seconds: of the training steps, without the test.
        weathers: in the leading process, all errors.
    """

    epoch: int
    epochs: int
    error: float
    best: float
    seconds: float
    weathers: dict[str, Error]


@dataclass(frozen=True)
class Outcome:
    """What a training came to.

    Attributes:
        errors: mean absolute test error S_0, S_1, ... of all epochs.
        best_epoch: whose weights :func:`train` gave to ``keep``; 0 if no epoch was better than the start.
        converged: the epoch that met the paper's criterion, or None.
    """

    errors: list[float]
    best_epoch: int
    converged: int | None


@dataclass(frozen=True, eq=False)
class Job:
    """A training to run.

    Attributes:
        learner: what learns, from ``frames``.
        train, test: indices of frames.
        settings: of the training.
        out: folder for checkpoints, ``rounds.jsonl`` and tensorboard.
        keep: called in the leading process when the averaged weights are the best so far, with the epoch, the network
            that holds them, and the test errors per weather; before the epoch's line in the ledger, so that a kill in
            between repeats it.
        identity: what else a resumed run must share, as JSON.
    """

    learner: Learner
    frames: LightFrames
    train: Sequence[int]
    test: Sequence[int]
    settings: ExtractorSettings
    out: Path
    keep: Callable[[int, nn.Module, dict[str, Error]], None] = lambda epoch, net, errors: None
    identity: dict[str, Any] = field(default_factory=dict)


def train(
    job: Job,
    processes: Processes = SINGLE_PROCESS,
    on_epoch: Callable[[EpochReport], None] = lambda report: None,
    on_step: Callable[[int, int], None] = lambda done, steps: None,
) -> Outcome:
    """Run a training on the processes' device, or go on, see :func:`loop.run_task`.

    Several processes share every batch and end as one process would, but for the order of sums.

    Args:
        on_step: called with the steps done and the steps of the epoch.
    """
    if not job.train or not job.test:
        raise RaucaError(f"{job.out}: no frames to {'train' if not job.train else 'test'} on; make a larger data set")
    settings, task = job.settings, _ExtractorTask(job, processes)
    identity = {
        **settings.identity(),
        **job.identity,
        "data": job.frames.digest,
        "held out": hashlib.sha256(json.dumps(list(map(int, job.test))).encode()).hexdigest()[:16],
        "processes": processes.size,
    }
    run = Run(
        job.out, settings.epochs * task.steps, task.steps, settings.lr, settings.clip or math.inf, settings.threads,
        identity, settings.schedule == "constant", test_first=True,
    )  # fmt: skip
    board: Board | None = None

    def tell(report: RoundReport[EpochReport]) -> None:
        nonlocal board
        if not processes.is_main:
            return
        found = report.findings
        board = board or Board(job.out / "tensorboard", found.epoch)
        curves = {} if math.isnan(report.loss) else {"loss": report.loss}
        curves |= {"test/mae": found.error} | {f"psnr_db/{name}": e.psnr_db for name, e in found.weathers.items()}
        board.scalars(curves, found.epoch)
        board.flush()
        on_epoch(found)

    try:
        run_task(task, run, tell, lambda n, _, __: on_step((n - 1) % task.steps + 1, task.steps), processes)
    finally:
        if board is not None:
            board.close()
    errors = task.in_order
    return Outcome(errors, errors.index(min(errors)), converged_epoch(errors, settings.eta))


@dataclass(frozen=True)
class _Shown:
    """This process's items of a step's batch, and what they count for in the mean over the processes."""

    epoch: int
    items: list[Item]
    weight: float


class _ExtractorTask(Task[_Shown, EpochReport]):
    """An epoch after another.

    Attributes:
        steps: of an epoch.
        errors: mean absolute test error of every epoch so far.
    """

    def __init__(self, job: Job, processes: Processes) -> None:
        self.job, self.processes, settings = job, processes, job.settings
        self.network = job.learner.net.to(processes.device)
        # Without weight decay AdamW is Adam.
        self.optimizer = torch.optim.AdamW(
            self.network.parameters(), lr=settings.lr, weight_decay=settings.weight_decay
        )
        self.average = AveragedCopy(self.network, settings.average, ahead=1)
        self._items = job.learner.items(job.train)
        self.steps = -(-len(self._items) // settings.batch)
        self.errors: dict[int, float] = {}
        if started(job.out):
            self.errors.update(read_ledger(job.out, lambda line: (line.integer("epoch"), line.number("mae"))))
        self._began: float | None = None

    def batch(self, step: int) -> _Shown:
        settings, (epoch, place) = self.job.settings, divmod(step, self.steps)
        self._began = self._began or time.perf_counter()
        order = named_rng(settings.seed, "order", epoch + 1).permutation(len(self._items))
        chosen = [self._items[i] for i in order[place * settings.batch : (place + 1) * settings.batch]]
        mine = self.processes.share(chosen)
        # A process that is left without an item takes one that counts for nothing: all must join in the mean.
        return _Shown(epoch + 1, mine or chosen[:1], len(mine) * self.processes.size / len(chosen))

    def loss(self, batch: _Shown, step: int) -> Tensor:
        self.network.train()
        device, wanted = self.processes.device, self.job.settings.precision
        ready = device.type == "cuda" and torch.cuda.is_bf16_supported()
        with torch.autocast(device.type, torch.bfloat16, wanted == "bfloat16" or (wanted == "auto" and ready)):
            loss = self.job.learner.loss(self.network, batch.items, lambda item: self._draw(batch.epoch, item))
        return loss * batch.weight

    def _draw(self, epoch: int, item: Item) -> np.random.Generator:
        return named_rng(self.job.settings.seed, "item", epoch, *item)

    def names(self, batch: _Shown) -> str:
        """The first frame whose loss alone is not finite, else the first of the batch."""
        learner, frames = self.job.learner, self.job.frames
        with torch.no_grad():
            for item in batch.items:
                if not torch.isfinite(learner.loss(self.network, [item], lambda item: self._draw(batch.epoch, item))):
                    return frames.get(item.frame).name
        return frames.get(batch.items[0].frame).name

    def test(self, step: int) -> EpochReport:
        """Measure, and keep the best. The leading process does; all learn the error."""
        job, found, epoch, network = self.job, dict[str, Error](), step // self.steps, self.average.network
        seconds = 0.0 if self._began is None else time.perf_counter() - self._began
        self._began = None
        if self.processes.is_main:
            found = measure(job.frames, job.test, lambda i, f: job.learner.render_of(network, i, f), TEST)
        (error,) = self.processes.broadcast([total(found.values()).mae])
        self.errors[epoch] = error
        if self.processes.is_main and error == min(self.errors.values()):
            job.keep(epoch, network, found)
        return EpochReport(epoch, job.settings.epochs, error, min(self.errors.values()), seconds, found)

    @property
    def in_order(self) -> list[float]:
        """``errors`` of epoch 0, 1, ..."""
        return [self.errors[epoch] for epoch in sorted(self.errors)]

    def finished(self) -> bool:
        return self.job.settings.stop_early and converged_epoch(self.in_order, self.job.settings.eta) is not None

    def to_json(self, tested: EpochReport) -> dict[str, Any]:
        weathers = {name: error.to_json() for name, error in tested.weathers.items()}
        return {"epoch": tested.epoch, "mae": tested.error, "seconds": tested.seconds, **weathers}
