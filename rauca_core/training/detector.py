"""Training a detector's network: what a step is shown, what it costs, and on which device."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import torch
from torch import Tensor, nn

from ..contract.seeding import named_rng, named_seed
from ..detect.synth.network import Truth
from ..runtime.devices import find_device
from .adversary import Adversary
from .inner_attack import attacked
from .loop import AveragedCopy, RoundReport, Run, Task, run_task
from .measure import Findings
from .samples import FOUR, Sample, Samples, draw_color
from .settings import DetectorSettings

ADVERSARY = "adversary."  # what its tensors' names in checkpoints begin with
OnRound = Callable[[RoundReport[Findings]], None]
OnStep = Callable[[int, int, float], None]


@dataclass(frozen=True, eq=False)
class Job:
    """A detector's training.

    Attributes:
        network: takes square sRGB batches (B, 3, S, S) in [0, 1]. ``losses(images, truths)`` are scalars by name, to be
            summed; ``dense(images)`` are predictions before non-maximum suppression, boxes in pixels; ``backbone`` is
            the pre-trained convolutions, which learn more slowly than the rest.
        student: the network knows its data already and is to keep what it knows. The statistics of its batch
            normalization stay as they are, and its losses are ``losses(images, truths, plain)``: with the same pictures
            in plain paint, to hold it to what it said of these.
        adversary: whose camouflages ``samples`` shows, and which learns from the same steps.
        samples, train: what to show it: frames by index.
        test: measures a network in evaluation mode, which lies on ``device``.
        out: folder for checkpoints and ``rounds.jsonl``.
        identity: what else a resumed run must share, as JSON.
        device: of the network, its losses and its optimizer; images are composed on the CPU.
    """

    network: nn.Module
    samples: Samples
    train: Sequence[int]
    test: Callable[[nn.Module], Findings]
    settings: DetectorSettings
    out: Path
    identity: dict[str, Any] = field(default_factory=dict)
    student: bool = False
    adversary: Adversary | None = None
    device: torch.device | str = "cpu"


def train(
    job: Job,
    on_round: OnRound = lambda report: None,
    on_step: OnStep = lambda done, steps, loss: None,
) -> tuple[nn.Module, Findings]:
    """Run a training, or go on; returns the averaged network, ready to infer on the job's device, and its last test.

    Raises:
        RaucaError: as of :func:`loop.run_task`.
    """
    settings = job.settings
    if settings.threads:
        cv2.setNumThreads(settings.threads)
    task = _DetectorTask(job)
    run = Run(
        job.out, settings.steps, settings.round, settings.lr, settings.clip, settings.threads,
        {**settings.identity(), **job.identity},
    )  # fmt: skip
    findings = run_task(task, run, on_round, on_step)
    return task.average.network, findings


@dataclass(frozen=True, eq=False)
class _Shown:
    """A step's images (B, 3, S, S) with their truths, and the indices of the frames in them.

    Attributes:
        plain: the images in plain paint, where a student's losses need them.
        limits: every other image, from the first on, in black and in white paint (B / 2, 3, S, S), where an attack
            inside the step needs them.
    """

    images: Tensor
    truths: list[Truth]
    frames: list[int]
    plain: Tensor | None = None
    limits: tuple[Tensor, Tensor] | None = None


class _DetectorTask(Task[_Shown, Findings]):
    """Steps on images composed for them."""

    network: Any

    def __init__(self, job: Job) -> None:
        self.job, self.device = job, find_device(job.device)
        self.network = job.network.to(self.device)
        settings = job.settings
        learning = [p for p in self.network.parameters() if p.requires_grad]
        of_backbone = {id(p) for p in self.network.backbone.parameters()}
        backbone, rest = ([p for p in learning if (id(p) in of_backbone) == begun] for begun in (True, False))
        self.optimizer = torch.optim.AdamW(
            [{"params": backbone, "share": settings.backbone_lr}, {"params": rest, "share": 1.0}],
            lr=settings.lr,
            weight_decay=settings.weight_decay,
        )
        self.average = AveragedCopy(self.network, settings.ema)

    def batch(self, step: int) -> _Shown:
        drawn = [self._draw(step, number) for number in range(self.job.settings.batch)]
        samples = [sample for sample, _ in drawn]
        images = torch.stack([s.image for s in samples]).to(self.device)
        shown = _Shown(images, [s.truth.to(self.device) for s in samples], [i for _, some in drawn for i in some])
        every = range(self.job.settings.batch)
        if self.job.student:
            colors = [draw_color(named_rng(self.job.settings.seed, "plain paint", step, number)) for number in every]
            shown = replace(shown, plain=self._painted(step, every, [torch.from_numpy(color) for color in colors]))
        if self.job.settings.inner_step:
            half = every[::2]
            black, white = (self._painted(step, half, [torch.full((3,), a)] * len(half)) for a in (0.0, 1.0))
            shown = replace(shown, limits=(black, white))
        return shown

    def _draw(self, step: int, number: int, paint: Tensor | None = None) -> tuple[Sample, list[int]]:
        """An image of a step, the same at every call but for its paint, and the frames in it."""
        rng = named_rng(self.job.settings.seed, "sight", step, number)
        shown = rng.choice(self.job.train, 4 if rng.random() < FOUR else 1).tolist()
        return self.job.samples.draw(shown, rng, paint), shown

    @torch.no_grad()
    def _painted(self, step: int, numbers: Sequence[int], paints: Sequence[Tensor]) -> Tensor:
        """Images of a step in other paints, (3,) linear albedo each."""
        images = [self._draw(step, n, paint[:, None, None])[0].image for n, paint in zip(numbers, paints, strict=True)]
        return torch.stack(images).to(self.device)

    def loss(self, batch: _Shown, step: int) -> Tensor:
        settings = self.job.settings
        self.network.train()
        if self.job.student:
            for module in self.network.modules():
                if isinstance(module, nn.BatchNorm2d):
                    module.eval()

        def summed(images: Tensor, truths: Sequence[Truth], plain: Tensor | None) -> Tensor:
            given = (images, truths) if plain is None else (images, truths, plain)
            with torch.random.fork_rng(devices=[self.device] if self.device.type == "cuda" else []):
                torch.manual_seed(named_seed(settings.seed, "step", step))
                with torch.autocast(self.device.type, torch.bfloat16, settings.precision == "bfloat16"):
                    losses = self.network.losses(*given)
                    return torch.stack([loss.float() for loss in losses.values()]).sum()

        images = batch.images
        if batch.limits is not None:
            rng = named_rng(settings.seed, "inner attack", step)
            reach, truths = settings.inner_step, batch.truths[::2]
            plain = None if batch.plain is None else batch.plain[::2]
            images = images.clone()
            images[::2] = attacked(images[::2], *batch.limits, lambda seen: summed(seen, truths, plain), reach, rng)
        return summed(images, batch.truths, batch.plain)

    def after_step(self, done: int) -> None:
        if self.job.adversary is not None:
            self.job.adversary.step(done)

    def names(self, batch: _Shown) -> str:
        return ", ".join(sorted({self.job.samples.frames.get(i).name for i in batch.frames}))

    def tensors(self) -> dict[str, Tensor]:
        adversary = self.job.adversary
        own = {} if adversary is None else {ADVERSARY + name: value for name, value in adversary.tensors().items()}
        return super().tensors() | own

    def restore(self, tensors: dict[str, Tensor]) -> None:
        own = {name: tensors.pop(name) for name in list(tensors) if name.startswith(ADVERSARY)}
        super().restore(tensors)
        if self.job.adversary is not None:
            self.job.adversary.restore({name.removeprefix(ADVERSARY): value for name, value in own.items()})

    def test(self, step: int) -> Findings:
        return self.job.test(self.average.network)

    def to_json(self, tested: Findings) -> dict[str, Any]:
        return tested.to_json()
