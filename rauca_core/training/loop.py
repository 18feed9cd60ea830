"""The training loop of our detectors: steps, tests, checkpoints, and a moving average of the weights."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import torch
from torch import Tensor, nn
from torch.nn.utils import clip_grad_norm_

from ..contract import RaucaError, StoppedError
from ..contract.files import append_line
from ..contract.json_lines import whole_lines
from ..contract.ledger import MAX_LEDGER_BYTES
from ..contract.seeding import named_rng, named_seed
from ..detect.synth.network import Truth
from ..detect.synth.networks import trainable
from ..runtime.checkpoint_files import POINTER
from ..runtime.cpu import keep_large_blocks, threads
from ..runtime.folder_lock import alone_in
from ..runtime.stopping import StopRequest, stop_request
from .checkpoint import restore_run, save_run
from .measure import ALL, Findings
from .settings import DetectorSettings
from .sights import FOUR, Sights

CHECKPOINTS = "checkpoints"
LEDGER = "rounds.jsonl"
WARM_UP = 0.05  # of all steps


@dataclass(frozen=True)
class RoundReport:
    """A round of steps and the test behind it, as told to callbacks; ``loss`` is the mean over its steps."""

    step: int
    steps: int
    loss: float
    findings: Findings


@dataclass(frozen=True, eq=False)
class Job:
    """A training to run.

    Attributes:
        network: a :class:`network.Trainable`.
        sights, train: what to show it: frames by index.
        test: measures a network in evaluation mode.
        out: folder for checkpoints and ``rounds.jsonl``.
        identity: what else a resumed run must share, as JSON.
        keep_norms: leave the statistics of batch normalization as they are, as for weights that know the data already.
    """

    network: nn.Module
    sights: Sights
    train: Sequence[int]
    test: Callable[[nn.Module], Findings]
    settings: DetectorSettings
    out: Path
    identity: dict[str, Any] = field(default_factory=dict)
    keep_norms: bool = False


def train(
    job: Job,
    resume: bool = False,
    on_round: Callable[[RoundReport], None] = lambda report: None,
    on_step: Callable[[int, int, float], None] = lambda done, steps, loss: None,
) -> tuple[nn.Module, Findings]:
    """Run or resume a training; returns the averaged network, ready to infer, and its last test.

    Random streams are functions of the seed and the step, so a resumed run ends in the same bits as one that never
    stopped. Ctrl-C and SIGTERM end the step in progress, write a checkpoint and raise.

    Raises:
        RaucaError: a folder that holds a run, or none to resume, or another process at work there; a loss or gradient
            that is not finite, with its step and frames; a stop.
    """
    with alone_in(job.out):
        started = (job.out / CHECKPOINTS / POINTER).is_file()
        if started != resume:
            hint = "resume it or choose another folder" if started else "start it without resuming"
            raise RaucaError(f"{job.out}: holds {'a' if started else 'no'} training with checkpoints; {hint}")
        keep_large_blocks()
        if job.settings.threads:
            cv2.setNumThreads(job.settings.threads)
        with threads(job.settings.threads), stop_request() as stop:
            return _Training(job).run(resume, stop, on_round, on_step)


class _Training:
    """A run in progress."""

    def __init__(self, job: Job) -> None:
        self.job, self.network = job, job.network
        settings = job.settings
        learning = [p for p in self.network.parameters() if p.requires_grad]
        of_body = {id(p) for p in trainable(self.network).body.parameters()}
        body, rest = ([p for p in learning if (id(p) in of_body) == begun] for begun in (True, False))
        self.optimizer = torch.optim.AdamW(
            [{"params": body, "share": settings.body_lr}, {"params": rest, "share": 1.0}],
            lr=settings.lr,
            weight_decay=settings.weight_decay,
        )
        self.average = copy.deepcopy(self.network).eval().requires_grad_(False)
        self.identity = {**settings.identity(), **job.identity}
        self.done = 0
        self.losses: list[float] = []  # of the round in progress

    def run(
        self,
        resume: bool,
        stop: StopRequest,
        on_round: Callable[[RoundReport], None],
        on_step: Callable[[int, int, float], None],
    ) -> tuple[nn.Module, Findings]:
        job, steps = self.job, self.job.settings.steps
        findings: Findings | None = None
        if resume:
            self.done, self.losses = restore_run(
                job.out / CHECKPOINTS, self.identity, self.network, self.average, self.optimizer
            )
            if self._round_ends() and self.done in _reported(job.out / LEDGER):
                self.losses = []
            elif self._round_ends():  # killed in the test behind it
                findings = self._report(on_round)
        while self.done < steps:
            self.losses.append(self._step(self.done))
            self.done += 1
            on_step(self.done, steps, self.losses[-1])
            if self._round_ends() or stop:
                self._save()
            if stop:
                raise StoppedError(f"{job.out}: stopped after step {self.done}")
            if self._round_ends():
                findings = self._report(on_round)
        return self.average, findings or job.test(self.average)

    def _round_ends(self) -> bool:
        return self.done % self.job.settings.round == 0 or self.done == self.job.settings.steps

    def _report(self, on_round: Callable[[RoundReport], None]) -> Findings:
        """Test, and write the round's line."""
        findings = self.job.test(self.average)
        report = RoundReport(self.done, self.job.settings.steps, sum(self.losses) / len(self.losses), findings)
        append_line(self.job.out / LEDGER, _line(report))
        on_round(report)
        self.losses = []
        return findings

    def _step(self, step: int) -> float:
        settings, lr = self.job.settings, self.job.settings.lr * self._schedule(step)
        for group in self.optimizer.param_groups:
            group["lr"] = lr * group["share"]
        images, truths, chosen = self._batch(step)
        self.network.train()
        if self.job.keep_norms:
            for module in self.network.modules():
                if isinstance(module, nn.BatchNorm2d):
                    module.eval()
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(named_seed(settings.seed, "step", step))
            with torch.autocast("cpu", torch.bfloat16, settings.precision == "bfloat16"):
                loss = sum_of(trainable(self.network).losses(images, truths))
        self.optimizer.zero_grad()
        loss.backward()
        norm = clip_grad_norm_(self.network.parameters(), settings.clip)
        if not torch.isfinite(loss.detach() + norm):
            names = ", ".join(sorted({self.job.sights.frames.get(i).name for i in chosen}))
            raise RaucaError(
                f"step {step + 1}: the loss or its gradient is not finite on {names}; "
                "lower the learning rate, or render these frames again"
            )
        self.optimizer.step()
        self._follow(step)
        return float(loss.detach())

    def _batch(self, step: int) -> tuple[Tensor, list[Truth], list[int]]:
        job, sights, chosen = self.job, [], []
        for number in range(job.settings.batch):
            rng = named_rng(job.settings.seed, "sight", step, number)
            shown = rng.choice(job.train, 4 if rng.random() < FOUR else 1).tolist()
            sights.append(job.sights.draw(shown, rng))
            chosen += shown
        return torch.stack([s.image for s in sights]), [s.truth for s in sights], chosen

    def _follow(self, step: int) -> None:
        """Move the average; early on it follows closely, as nothing is worth remembering yet."""
        decay = min(self.job.settings.ema, (1 + step) / (10 + step))
        with torch.no_grad():
            for mean, now in zip(self.average.state_dict().values(), self.network.state_dict().values(), strict=True):
                if mean.dtype.is_floating_point:
                    mean.lerp_(now, 1 - decay)
                else:
                    mean.copy_(now)

    def _schedule(self, step: int) -> float:
        whole = self.job.settings.steps
        rising = (step + 1) / max(1.0, WARM_UP * whole)
        return min(rising, 0.5 * (1 + math.cos(math.pi * step / whole)))

    def _save(self) -> None:
        save_run(
            self.job.out / CHECKPOINTS,
            self.identity,
            self.done,
            self.losses,
            self.network,
            self.average,
            self.optimizer,
        )


def sum_of(losses: dict[str, Tensor]) -> Tensor:
    """One scalar of them all."""
    return torch.stack([loss.float() for loss in losses.values()]).sum()


def _reported(ledger: Path) -> set[int]:
    """The rounds of which a line is there, by their last step."""
    if not ledger.is_file():
        return set()
    return set(whole_lines(ledger, MAX_LEDGER_BYTES, "a ledger", lambda line: line.integer("step")))


def _line(report: RoundReport) -> str:
    found = report.findings
    return json.dumps({"step": report.step, "loss": report.loss, "ap50": found.ap50.get(ALL), **found.to_json()})
