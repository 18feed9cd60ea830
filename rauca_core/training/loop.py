"""The training loop of the house: steps, a running mean of the weights, tests, checkpoints, and going on after a stop.

What is learnt is a :class:`Task`: it draws a step's batch, computes its loss and tests what was learnt. The loop does
the rest: the learning rate, the backward pass and the optimizer's step, ``rounds.jsonl`` with a line for every test,
checkpoints, and the end of a run by Ctrl-C or SIGTERM. Nothing here knows of detectors.

A task's random streams are functions of the seed and the step, never of a generator's past: a checkpoint then holds no
generator, and a resumed run ends in the same bits as one that never stopped.

Several processes may share the steps (:mod:`rauca_core.runtime.distributed`): the task takes its share of every batch,
and process 0 writes. The device is the task's: the loop moves nothing.
"""

from __future__ import annotations

import copy
import json
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

import torch
from torch import Tensor, nn
from torch.nn.utils import clip_grad_norm_

from ..contract import RaucaError, StoppedError
from ..contract.dataset import MAX_LEDGER_BYTES
from ..contract.files import append_line
from ..contract.schema import Fields, whole_lines
from ..runtime.devices import keep_large_blocks, threads
from ..runtime.distributed import SINGLE_PROCESS, Processes
from ..runtime.stopping import StopRequest, stop_request
from ..runtime.tensor_files import (
    CHECKPOINTS,
    Checkpoint,
    held_run,
    load_checkpoint,
    require_same,
    save_checkpoint,
)

LEDGER = "rounds.jsonl"
WARM_UP = 0.05  # of all steps

Batch = TypeVar("Batch")
Tested = TypeVar("Tested")
Read = TypeVar("Read")


class AveragedCopy:
    """A copy of a network, its buffers too, that follows its weights by an exponential mean.

    Args:
        decay: weight of the past at every step, in [0, 1); early on it is less, as nothing is worth remembering yet.
        ahead: how many steps more than were taken count as taken, early on.

    Attributes:
        network: the copy, in evaluation mode.
    """

    def __init__(self, network: nn.Module, decay: float, ahead: int = 0) -> None:
        self._followed, self._decay, self._ahead = network, decay, ahead
        self.network = copy.deepcopy(network).eval().requires_grad_(False)

    @torch.no_grad()
    def update(self, steps: int) -> None:
        """Take the weights in after ``steps`` steps."""
        steps += self._ahead
        past = min(self._decay, steps / (9 + steps))
        followed = self._followed.state_dict().values()
        for mean, now in zip(self.network.state_dict().values(), followed, strict=True):
            if mean.dtype.is_floating_point:
                mean.lerp_(now, 1 - past)
            else:
                mean.copy_(now)


class Task(ABC, Generic[Batch, Tested]):
    """What is learnt.

    Attributes:
        network: on its device.
        optimizer: of its parameters; a group with an entry ``share`` learns at that share of the learning rate.
        average: of its weights: what is tested and kept.
    """

    network: nn.Module
    optimizer: torch.optim.Optimizer
    average: AveragedCopy

    @abstractmethod
    def batch(self, step: int) -> Batch:
        """What a step learns from; steps count from 0."""

    @abstractmethod
    def loss(self, batch: Batch, step: int) -> Tensor:
        """The scalar to descend."""

    @abstractmethod
    def names(self, batch: Batch) -> str:
        """Of what is in a batch, for the error when its loss is not finite."""

    @abstractmethod
    def test(self, step: int) -> Tested:
        """Measure the averaged weights, after ``step`` steps."""

    def after_step(self, done: int) -> None:
        """Called after each step of the optimizer, ``done`` of which were taken."""

    def finished(self) -> bool:
        """Asked after a test: whether to stop before the last step."""
        return False

    @abstractmethod
    def to_json(self, tested: Tested) -> dict[str, Any]:
        """What the test's line of ``rounds.jsonl`` holds beside the step and its loss."""

    def tensors(self) -> dict[str, Tensor]:
        """All that a step changes, by name."""
        found = {f"net.{name}": value for name, value in self.network.state_dict().items()}
        found |= {f"average.{name}": value for name, value in self.average.network.state_dict().items()}
        for number, entries in self.optimizer.state_dict()["state"].items():
            found |= {f"optimizer.{number}.{name}": torch.as_tensor(value) for name, value in entries.items()}
        return found

    def restore(self, tensors: dict[str, Tensor]) -> None:
        """Go back to :meth:`tensors`; raises :class:`RaucaError` where they are another network's."""
        net, average, state = dict[str, Tensor](), dict[str, Tensor](), dict[int, dict[str, Tensor]]()
        try:
            for name, value in tensors.items():
                part, rest = name.split(".", 1)
                if part == "optimizer":
                    number, entry = rest.split(".", 1)
                    state.setdefault(int(number), {})[entry] = value
                else:
                    {"net": net, "average": average}[part][rest] = value
            self.network.load_state_dict(net)
            self.average.network.load_state_dict(average)
            groups = self.optimizer.state_dict()["param_groups"]
            self.optimizer.load_state_dict({"state": state, "param_groups": groups})
        except (RuntimeError, ValueError, KeyError) as error:
            raise RaucaError("checkpoint: it is of another network; start the training in a new folder") from error


@dataclass(frozen=True)
class RoundReport(Generic[Tested]):
    """A round of steps and the test behind it, as told to callbacks; ``loss`` is their mean, NaN before the first."""

    step: int
    steps: int
    loss: float
    findings: Tested


@dataclass(frozen=True)
class Run:
    """How long a training runs, and where it lies.

    Attributes:
        out: folder for checkpoints and ``rounds.jsonl``.
        steps: of the optimizer.
        every: steps between tests and checkpoints.
        lr: learning rate; it rises over the first 5 % of the steps and falls to 0 on a half cosine.
        clip: largest norm of the gradient.
        threads: of torch; None leaves torch's own choice.
        identity: what a resumed run must share, as JSON.
        constant: keep the learning rate as it is.
        test_first: test before the first step, too.
    """

    out: Path
    steps: int
    every: int
    lr: float
    clip: float = math.inf
    threads: int | None = None
    identity: dict[str, Any] = field(default_factory=dict)
    constant: bool = False
    test_first: bool = False


def run_task(
    task: Task[Batch, Tested],
    run: Run,
    on_round: Callable[[RoundReport[Tested]], None] = lambda report: None,
    on_step: Callable[[int, int, float], None] = lambda done, steps, loss: None,
    processes: Processes = SINGLE_PROCESS,
) -> Tested:
    """Run a training, or go on with the one in its folder; returns its last test.

    Ctrl-C and SIGTERM end the step in progress, write a checkpoint and raise.

    Args:
        on_step: called with the steps done, all steps, and the loss.

    Raises:
        RaucaError: a folder that holds another run, or another process at work there; a loss or gradient that is not
            finite, with its step and what was in its batch; a stop.
    """
    with held_run(run.out, processes) as begun:
        keep_large_blocks()
        with threads(run.threads), stop_request() as stop:
            return _Loop(task, run, on_round, on_step, processes).run(begun, stop)


@dataclass
class _Loop(Generic[Batch, Tested]):
    """A run in progress: the steps done, and the losses of the round in progress."""

    task: Task[Batch, Tested]
    settings: Run
    on_round: Callable[[RoundReport[Tested]], None]
    on_step: Callable[[int, int, float], None]
    processes: Processes
    done: int = 0
    losses: list[float] = field(default_factory=list)

    def run(self, begun: bool, stop: StopRequest) -> Tested:
        run, tested = self.settings, None
        if begun:
            self._restore(load_checkpoint(run.out / CHECKPOINTS))
            if self._round_ends() and self.done in read_ledger(run.out, lambda line: line.integer("step")):
                self.losses = []
            elif self._round_ends():  # killed in the test behind it
                tested = self._test()
        elif self.processes.is_main:
            (run.out / LEDGER).unlink(missing_ok=True)  # of a run whose checkpoints somebody removed
        if not begun and run.test_first:
            self._save()
            tested = self._test()
        while self.done < run.steps and not (self._round_ends() and self.task.finished()):
            self.losses.append(self._step(self.done))
            self.done += 1
            self.on_step(self.done, run.steps, self.losses[-1])
            stopped = self.processes.any(bool(stop))
            if self._round_ends() or stopped:
                self._save()
            if stopped:
                raise StoppedError(f"{run.out}: stopped after step {self.done}")
            if self._round_ends():
                tested = self._test()
        return self.task.test(self.done) if tested is None else tested

    def _save(self) -> None:
        if self.processes.is_main:
            tensors = {"losses": torch.tensor(self.losses, dtype=torch.float64), **self.task.tensors()}
            save_checkpoint(self.settings.out / CHECKPOINTS, Checkpoint(self.done, self.settings.identity, tensors))

    def _restore(self, checkpoint: Checkpoint) -> None:
        require_same(self.settings.out, "training", checkpoint.identity, self.settings.identity)
        tensors = dict(checkpoint.tensors)
        self.done, self.losses = checkpoint.step, tensors.pop("losses", torch.zeros(0)).tolist()
        self.task.restore(tensors)

    def _round_ends(self) -> bool:
        return self.done % self.settings.every == 0 or self.done == self.settings.steps

    def _test(self) -> Tested:
        """Test, and write the round's line."""
        tested = self.task.test(self.done)
        loss = sum(self.losses) / len(self.losses) if self.losses else math.nan
        report = RoundReport(self.done, self.settings.steps, loss, tested)
        if self.processes.is_main:
            line = {"step": report.step, "loss": loss if self.losses else None, **self.task.to_json(tested)}
            append_line(self.settings.out / LEDGER, json.dumps(line))
        self.on_round(report)
        self.losses = []
        return tested

    def _step(self, step: int) -> float:
        task, run = self.task, self.settings
        lr = run.lr if run.constant else run.lr * _rise_and_fall(step, run.steps)
        for group in task.optimizer.param_groups:
            group["lr"] = lr * group.get("share", 1.0)
        batch = task.batch(step)
        loss = task.loss(batch, step)
        task.optimizer.zero_grad()
        loss.backward()
        self.processes.average_gradients(task.network)
        norm = clip_grad_norm_(task.network.parameters(), run.clip)
        if self.processes.any(not bool(torch.isfinite(loss.detach() + norm))):
            raise RaucaError(
                f"step {step + 1}: the loss or its gradient is not finite on {task.names(batch)}; "
                "lower the learning rate, or render these frames again"
            )
        task.optimizer.step()
        task.average.update(step + 1)
        task.after_step(step + 1)
        return float(loss.detach())


def _rise_and_fall(step: int, steps: int) -> float:
    """The learning rate of a step, relative to the highest."""
    rising = (step + 1) / max(1.0, WARM_UP * steps)
    return min(rising, 0.5 * (1 + math.cos(math.pi * step / steps)))


def read_ledger(folder: Path, what: Callable[[Fields], Read]) -> list[Read]:
    """``what`` is read of each line of a run's ``rounds.jsonl``, one for each round that was tested."""
    ledger = folder / LEDGER
    return list(whole_lines(ledger, MAX_LEDGER_BYTES, "a ledger", what)) if ledger.is_file() else []
