"""The training loop of every extractor: epochs, tests, checkpoints, the best weights, and when to stop."""

from __future__ import annotations

import contextlib
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
from torch.nn.utils import clip_grad_norm_

from ..contract import RaucaError, StoppedError
from ..contract.color import TEST
from ..contract.files import append_line
from ..contract.seeding import named_rng
from ..runtime.board import Board
from ..runtime.checkpoint_files import POINTER
from ..runtime.cpu import keep_large_blocks, threads
from ..runtime.distributed import Processes
from ..runtime.folder_lock import alone_in
from ..runtime.stopping import StopRequest, stop_request
from .averaging import WeightAverage
from .convergence import converged_epoch
from .frames import LightFrames
from .learner import Draw, Item, Learner
from .metrics import Error, measure, total
from .settings import TrainingSettings
from .training_state import TrainingState, load_state, restore, save_state, state_tensors

CHECKPOINTS = "checkpoints"
LEDGER = "epochs.jsonl"
WARM_UP = 0.05  # of all steps


@dataclass(frozen=True)
class EpochReport:
    """One epoch, as told to callbacks.

    Attributes:
        epoch: counted from 1; 0 is the test before the first step.
        epochs: at most.
        loss: mean over the steps, NaN at epoch 0.
        error: mean absolute test error, sRGB values.
        best: the least so far.
        seconds: of the training steps, without the test.
    """

    epoch: int
    epochs: int
    loss: float
    error: float
    best: float
    seconds: float


@dataclass
class Outcome:
    """What a training came to.

    Attributes:
        errors: mean absolute test error S_0, S_1, ... of all epochs.
        best_epoch: whose weights :func:`train` gave to ``keep``; 0 if no epoch was better than the start.
        converged: the epoch that met the paper's criterion, or None.
        seconds: per epoch trained in this process, without tests.
    """

    errors: list[float]
    best_epoch: int
    converged: int | None
    seconds: list[float] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Job:
    """A training to run.

    Attributes:
        learner: what learns, from ``frames``.
        train, test: indices of frames.
        settings: of the loop.
        out: folder for checkpoints, ``epochs.jsonl`` and tensorboard.
        keep: called in the leading process when the averaged weights, which the network then holds, are the best so
            far, with the epoch and the test errors per weather; before the epoch's checkpoint, so that a kill in
            between repeats it.
        identity: what else a resumed run must share, as JSON.
    """

    learner: Learner
    frames: LightFrames
    train: Sequence[int]
    test: Sequence[int]
    settings: TrainingSettings
    out: Path
    keep: Callable[[int, dict[str, Error]], None] = lambda epoch, errors: None
    identity: dict[str, Any] = field(default_factory=dict)


def train(
    job: Job,
    processes: Processes,
    resume: bool = False,
    on_epoch: Callable[[EpochReport], None] = lambda report: None,
    on_step: Callable[[int, int], None] = lambda done, steps: None,
) -> Outcome:
    """Run or resume a training.

    A run resumed on the same machine ends in the same bits as one that never stopped. Several processes share every
    batch and end as one process would, but for the order of sums.

    Args:
        on_step: called with the steps done and the steps of the epoch.

    Raises:
        RaucaError: a folder that holds a run, or none to resume, or another process at work there; a loss or gradient
            that is not finite, which names the frame; a stop by Ctrl-C or SIGTERM, after the step in progress.
    """
    if not job.train or not job.test:
        raise RaucaError(f"{job.out}: no frames to {'train' if not job.train else 'test'} on; make a larger data set")
    with alone_in(job.out) if processes.is_main else contextlib.nullcontext():
        started = (job.out / CHECKPOINTS / POINTER).is_file()
        if started != resume:
            hint = "resume it or choose another folder" if started else "start it without resuming"
            raise RaucaError(f"{job.out}: holds {'a' if started else 'no'} training with checkpoints; {hint}")
        keep_large_blocks()
        with threads(job.settings.threads), stop_request() as stop:
            return _Training(job, processes, on_step, stop).run(resume, on_epoch)


class _Training:
    """A run in progress."""

    def __init__(self, job: Job, processes: Processes, on_step: Callable[[int, int], None], stop: StopRequest) -> None:
        self.job, self.processes, self.on_step, self.stop = job, processes, on_step, stop
        self.net = job.learner.net.to(processes.device)
        self.wrapped = processes.wrap(self.net)
        self.average = WeightAverage(self.net, job.settings.average)
        settings = job.settings
        # Without weight decay AdamW is Adam.
        self.optimizer = torch.optim.AdamW(self.net.parameters(), lr=settings.lr, weight_decay=settings.weight_decay)
        self.identity = {
            **settings.identity(),
            **job.identity,
            "data": job.frames.digest,
            "held out": hashlib.sha256(json.dumps(list(map(int, job.test))).encode()).hexdigest()[:16],
            "processes": processes.size,
        }
        self.items = job.learner.items(job.train)
        self.steps = -(-len(self.items) // settings.batch)
        self.errors: list[float] = []

    def run(self, resume: bool, on_epoch: Callable[[EpochReport], None]) -> Outcome:
        job, seconds = self.job, list[float]()
        folder = job.out / CHECKPOINTS
        if resume:
            state = load_state(folder, self.identity)
            restore(self.net, self.optimizer, state.tensors, folder)
            self.average.restore(state.tensors)
            self.errors = state.errors
        board = Board(job.out / "tensorboard", len(self.errors)) if self.processes.is_main else None
        try:
            if not resume:
                self._test(0, math.nan, 0.0, board, on_epoch)
            while len(self.errors) <= job.settings.epochs and not self._done():
                epoch, before = len(self.errors), time.perf_counter()
                loss = self._epoch(epoch)
                seconds.append(time.perf_counter() - before)
                self._test(epoch, loss, seconds[-1], board, on_epoch)
        finally:
            if board is not None:
                board.close()
        best = min(range(len(self.errors)), key=self.errors.__getitem__)
        return Outcome(self.errors, best, converged_epoch(self.errors, self.job.settings.eta), seconds)

    def _done(self) -> bool:
        return self.job.settings.stop_early and converged_epoch(self.errors, self.job.settings.eta) is not None

    def _epoch(self, epoch: int) -> float:
        """All items once, in an order of the epoch's own; returns the mean loss."""
        settings, losses = self.job.settings, 0.0
        order = named_rng(settings.seed, "order", epoch).permutation(len(self.items))
        self.net.train()
        for step in range(self.steps):
            chosen = [self.items[i] for i in order[step * settings.batch : (step + 1) * settings.batch]]
            losses += self._step(epoch, step, chosen)
            self.on_step(step + 1, self.steps)
            if self.processes.any(bool(self.stop)):
                raise StoppedError(f"{self.job.out}: stopped in epoch {epoch}; those before it are kept")
        return losses / self.steps

    def _step(self, epoch: int, step: int, items: list[Item]) -> float:
        settings = self.job.settings

        def draw(item: Item) -> np.random.Generator:
            return named_rng(settings.seed, "item", epoch, *item)

        # A process that is left without an item takes one that counts for nothing: all must join in the mean.
        mine = self.processes.share(items) or items[:1]
        weight = len(self.processes.share(items)) * self.processes.size / len(items)
        for group in self.optimizer.param_groups:
            group["lr"] = settings.lr * self._schedule((epoch - 1) * self.steps + step)
        self.optimizer.zero_grad()
        with self._precision():
            loss = self.job.learner.loss(self.wrapped, mine, draw)
        (loss * weight).backward()
        norm = clip_grad_norm_(self.net.parameters(), settings.clip or math.inf)
        if self.processes.any(not bool(torch.isfinite(loss) & torch.isfinite(norm))):
            raise RaucaError(
                f"epoch {epoch}, step {step + 1}: the loss or its gradient is not finite on frame "
                f"{self._culprit(mine, draw)}; remove the frame, or lower the learning rate"
            )
        self.optimizer.step()
        self.average.update((epoch - 1) * self.steps + step + 1)
        return float(loss.detach()) * weight

    def _culprit(self, items: list[Item], draw: Draw) -> str:
        """The first frame whose loss alone is not finite, else the first of the batch."""
        with torch.no_grad():
            for item in items:
                if not torch.isfinite(self.job.learner.loss(self.net, [item], draw)):
                    return self.job.frames.get(item.frame).name
        return self.job.frames.get(items[0].frame).name

    def _schedule(self, step: int) -> float:
        if self.job.settings.schedule == "constant":
            return 1.0
        whole = self.job.settings.epochs * self.steps
        rising = (step + 1) / max(1.0, WARM_UP * whole)
        return min(rising, 0.5 * (1 + math.cos(math.pi * step / whole)))

    def _precision(self) -> torch.autocast:
        device, wanted = self.processes.device, self.job.settings.precision
        ready = device.type == "cuda" and torch.cuda.is_bf16_supported()
        return torch.autocast(device.type, torch.bfloat16, wanted == "bfloat16" or (wanted == "auto" and ready))

    def _test(
        self,
        epoch: int,
        loss: float,
        seconds: float,
        board: Board | None,
        on_epoch: Callable[[EpochReport], None],
    ) -> None:
        """Measure, keep the best, write the checkpoint. The leading process does; all learn the error."""
        job, found = self.job, dict[str, Error]()
        with self.average.shown():
            if self.processes.is_main:
                self.net.eval()
                found = measure(job.frames, job.test, job.learner.render_of, TEST)
            (error,) = self.processes.broadcast([total(found.values()).mae])
            self.errors.append(error)
            if board is None:
                return
            report = EpochReport(epoch, job.settings.epochs, loss, error, min(self.errors), seconds)
            if error == report.best:
                job.keep(epoch, found)
        # Before the checkpoint: a kill in between repeats the epoch and its line, and loses neither.
        append_line(job.out / LEDGER, _line(report, found))
        tensors = state_tensors(self.net, self.optimizer) | self.average.tensors()
        save_state(job.out / CHECKPOINTS, TrainingState(epoch, self.errors, self.identity, tensors))
        _record(board, report, found)
        on_epoch(report)


def _record(board: Board, report: EpochReport, found: dict[str, Error]) -> None:
    curves = {} if math.isnan(report.loss) else {"loss": report.loss}
    curves |= {"test/mae": report.error} | {f"psnr_db/{weather}": error.psnr_db for weather, error in found.items()}
    board.scalars(curves, report.epoch)
    board.flush()


def _line(report: EpochReport, found: dict[str, Error]) -> str:
    loss = None if math.isnan(report.loss) else report.loss
    weathers = {name: error.to_json() for name, error in found.items()}
    return json.dumps({"epoch": report.epoch, "loss": loss, "mae": report.error, "seconds": report.seconds, **weathers})
