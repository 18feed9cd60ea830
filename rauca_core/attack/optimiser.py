"""Optimising a camouflage end to end: UV map -> pixels -> light -> augmentation -> detector, and back."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from ..checkpoint_files import POINTER
from ..contract import Dataset, RaucaError
from ..contract.seeding import named_rng, named_seed
from ..cpu import keep_large_blocks, threads
from ..detect import Detector, class_index
from ..render import TAP_FORMAT, Canvas, undisplay
from .augmentation import Augmentation
from .checkpoint import Checkpoint, check_identity, load_checkpoint, save_checkpoint
from .frames import FrameStore, ReadyFrame, boxes_of, render_batch
from .journal import Journal, StepReport
from .losses import SmoothLoss, attack_loss, detection_score
from .result import write_result
from .settings import OptimiserSettings
from .stopping import stop_request

CHECKPOINTS = "checkpoints"
OnStep = Callable[[StepReport], None]
OnView = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class _Detected:
    """What the detector made of a batch: mean attack loss and score, and the images' gradient (B, 3, H, W)."""

    attack: float
    score: float
    gradient: Tensor


def optimise(
    dataset: Dataset,
    detector: Detector,
    settings: OptimiserSettings,
    out: Path,
    on_step: OnStep | None = None,
    resume: bool = False,
    on_view: OnView | None = None,
) -> Path:
    """Optimise a camouflage on a data set against a detector.

    ``out`` receives ``camouflage.json`` and ``.png``, ``history.jsonl``, ``tensorboard/`` and ``checkpoints/``. A run
    resumed on the same machine ends in the same bits as one that never stopped.

    Args:
        dataset: with light maps; frames without a box are skipped.
        detector: its class names must hold ``settings.target``.
        on_step: called after every step; progress bars are the caller's business.
        resume: go on from the latest checkpoint in ``out``.
        on_view: called, from another thread, with the cameras whose taps are built and how many there are.

    Returns:
        The path of ``camouflage.json``.

    Raises:
        RaucaError: unusable data set, detector or folder; a loss or gradient that is not finite (the frame is named);
            a stop by Ctrl-C or SIGTERM, after a checkpoint.
    """
    out = Path(out)
    started = (out / CHECKPOINTS / POINTER).is_file()
    if started != resume:
        hint = "resume it or choose another folder" if started else "start it without resuming"
        raise RaucaError(f"{out}: holds {'a' if started else 'no'} run with checkpoints; {hint}")
    keep_large_blocks()
    with threads(settings.threads):
        run = Run(dataset, detector, settings)
        if resume:
            run.restore(out / CHECKPOINTS)
        with run.store.warming(run.upcoming(), on_view):
            _loop(run, out, on_step)
        return write_result(out, run.store.vehicle, run.store.pyramid, run.limited(), settings, detector.name)


def _loop(run: Run, out: Path, on_step: OnStep | None) -> None:
    """Step, report and checkpoint until done or asked to stop."""
    total, every = run.settings.steps, run.settings.checkpoint_every
    journal, saved = Journal(out, run.step), run.step
    try:
        with stop_request() as stop:
            while run.step < total and not stop:
                report = run.advance()
                journal.add(report)
                if on_step is not None:
                    on_step(report)
                if run.step % every == 0 or run.step == total or stop:
                    journal.preview(run.step, run.uv_map_srgb(), run.last_image)
                    journal.flush()  # first: a resumed run cuts the history to its checkpoint, never extends it
                    run.save(out / CHECKPOINTS)
                    saved = run.step
            if run.step < total:
                if saved != run.step:
                    journal.flush()
                    run.save(out / CHECKPOINTS)
                raise RaucaError(f"{out}: stopped after step {run.step} of {total}; run the same command with --resume")
    finally:
        journal.close()


class Run:
    """The state of an optimisation between two steps.

    Attributes:
        step: steps done.
        texels: (P, 3) sRGB parameter, the paintable texels of the UV map.
        last_image: (3, H, W) sRGB, the latest batch's first frame as rendered.
    """

    def __init__(self, dataset: Dataset, detector: Detector, settings: OptimiserSettings) -> None:
        self.settings, self.detector = settings, detector
        self.store = FrameStore(dataset, settings)
        self.label = class_index(detector, settings.target)
        self.texels = _start(len(self.store.pyramid.texels), settings).requires_grad_()
        self.adam = torch.optim.Adam([self.texels], lr=settings.lr, fused=True)
        self.smooth = SmoothLoss(self.store.pyramid.texels, settings.map_size)
        frames = _digest(dataset, self.store)
        made_by = {"detector": detector.fingerprint, "frames": frames, "taps": TAP_FORMAT}
        self.identity = {**settings.identity(), **made_by}
        self.step, self.last_image = 0, torch.zeros(3, 1, 1)

    def advance(self) -> StepReport:
        """Take one step of Eq. 8 on the step's own frames and augmentation."""
        begin, settings = time.perf_counter(), self.settings
        with threads(1):
            batch = [self.store.ready(i) for i in self._draw()]
            images = render_batch(batch, Canvas(self.store.pyramid, undisplay(self.limited())))
        # Two backward passes, cut at the images: the detector's share can be timed, and a bad frame named.
        before = time.perf_counter()
        detected = self._attack(images.detach(), batch)
        detector_seconds = time.perf_counter() - before
        with threads(1):
            smooth = self._descend(images, detected, batch)
        self.step, self.last_image = self.step + 1, images[0].detach()
        loss = settings.alpha * detected.attack + settings.beta * smooth
        seconds = time.perf_counter() - begin
        return StepReport(
            self.step, settings.steps, loss, detected.attack, smooth, detected.score, seconds, detector_seconds
        )

    def _descend(self, images: Tensor, detected: _Detected, batch: list[ReadyFrame]) -> float:
        """Carry the images' gradient to the UV map and step; returns the smoothness loss, Eq. 7."""
        smooth = self.smooth(self.limited())
        self.adam.zero_grad(set_to_none=True)
        torch.autograd.backward([images, smooth * self.settings.beta], [detected.gradient, None])
        if self.texels.grad is None or not torch.isfinite(self.texels.grad).all():
            names = ", ".join(f.frame.id for f in batch)
            raise RaucaError(
                f"step {self.step + 1}: the UV map's gradient is not finite on frames {names}; remove them"
            )
        self.adam.step()
        if self.settings.limit == "project":
            with torch.no_grad():
                self.texels.clamp_(0.0, 1.0)
        return float(smooth.detach())

    def limited(self) -> Tensor:
        """The texels (P, 3) sRGB as rendered, within [0, 1]; ``project`` keeps them there, ``clamp`` clips here."""
        return self.texels.clamp(0.0, 1.0)

    def uv_map_srgb(self) -> Tensor:
        """The UV map (3, size, size), black where nothing is paintable."""
        flat = torch.zeros(self.settings.map_size**2, 3)
        flat[torch.from_numpy(self.store.pyramid.texels)] = self.limited().detach()
        return flat.T.reshape(3, self.settings.map_size, self.settings.map_size)

    def _draw(self) -> list[int]:
        """The frames of the next step."""
        count, batch = len(self.store), self.settings.batch
        places = range(self.step * batch, (self.step + 1) * batch)
        orders = {epoch: self._epoch(epoch) for epoch in {place // count for place in places}}
        return [int(orders[place // count][place % count]) for place in places]

    def upcoming(self) -> list[int]:
        """All frames, those first that the next steps draw."""
        epoch, place = divmod(self.step * self.settings.batch, len(self.store))
        return np.roll(self._epoch(epoch), -place).tolist()

    def _epoch(self, epoch: int) -> NDArray[np.int64]:
        """The order of an epoch: a shuffle of its own, named by seed and epoch."""
        return named_rng(self.settings.seed, "order", epoch).permutation(len(self.store))

    def _attack(self, images: Tensor, batch: list[ReadyFrame]) -> _Detected:
        """Eq. 6 on a batch of sRGB images (B, 3, H, W), with its gradient."""
        images.requires_grad_()
        seen, boxes = images, boxes_of(batch).to(images)
        if self.settings.roa:
            seen, boxes = Augmentation.draw(named_rng(self.settings.seed, "roa", self.step), len(batch))(seen, boxes)
        if self.settings.detector_size is not None:
            side = self.settings.detector_size
            boxes = boxes * (side / seen.shape[-1])
            seen = functional.interpolate(seen, size=(side, side), mode="bilinear", antialias=True, align_corners=False)
        scores = detection_score(self.detector.dense(seen), boxes, self.label)
        losses = attack_loss(scores)
        (self.settings.alpha * losses.mean()).backward()
        gradient = images.grad if images.grad is not None else torch.zeros_like(images)
        for frame, loss, part in zip(batch, losses, gradient, strict=True):
            if not torch.isfinite(loss) or not torch.isfinite(part).all():
                raise RaucaError(
                    f"step {self.step + 1}: the loss or its gradient is not finite on frame {frame.frame.id}; "
                    "check the detector's weights, then remove the frame"
                )
        return _Detected(float(losses.detach().mean()), float(scores.detach().mean()), gradient)

    def save(self, folder: Path) -> None:
        """Write a checkpoint."""
        state = self.adam.state[self.texels]
        tensors = {
            "texels": self.texels,
            "exp_avg": state["exp_avg"],
            "exp_avg_sq": state["exp_avg_sq"],
            "adam_step": state["step"],
        }
        save_checkpoint(folder, Checkpoint(self.step, self.identity, tensors))

    def restore(self, folder: Path) -> None:
        """Go back to the latest checkpoint; refuses one made under other conditions."""
        checkpoint = load_checkpoint(folder)
        check_identity(folder.parent, checkpoint.identity, self.identity)
        if checkpoint.tensors["texels"].shape != self.texels.shape:
            raise RaucaError(f"{folder}: the checkpoint's UV map has other texels; start the run in a new folder")
        with torch.no_grad():
            self.texels.copy_(checkpoint.tensors["texels"])
        self.adam.state[self.texels] = {
            "step": checkpoint.tensors["adam_step"],
            "exp_avg": checkpoint.tensors["exp_avg"],
            "exp_avg_sq": checkpoint.tensors["exp_avg_sq"],
        }
        self.step = checkpoint.step


def _start(count: int, settings: OptimiserSettings) -> Tensor:
    if settings.start == "plain":
        return torch.full((count, 3), 0.5)
    generator = torch.Generator().manual_seed(named_seed(settings.seed, "start"))
    return torch.rand(count, 3, generator=generator)


def _digest(dataset: Dataset, store: FrameStore) -> str:
    """Names the data: plan, geometry and the list of frames."""
    plan: dict[str, Any] = dataset.plan.to_json()
    text = json.dumps([plan, store.vehicle.geometry_id, [f.id for f in store.frames]], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]
