"""One optimization between two steps: UV map -> pixels -> light -> augmentation -> detectors, and back."""

from __future__ import annotations

import hashlib
import json
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from ..contract import Dataset, RaucaError
from ..contract.seeding import named_rng, named_seed
from ..render import TAP_FORMAT, MipmappedTexture, srgb_to_linear
from ..runtime.devices import threads
from ..runtime.distributed import SINGLE_PROCESS, Processes
from ..runtime.tensor_files import Checkpoint
from .augmentation import RANGES, Augmentation
from .drawn_frames import frame_store
from .ensemble import Attacked, DetectorEnsemble
from .frame_order import FrameOrder
from .frames import FrameStore, ReadyFrame, boxes_of, shade
from .history import StepReport, Stopwatch
from .paint_losses import paint_of, prior, smooth_paint, smooth_picture
from .settings import OptimizerSettings
from .texture import Texture, make_texture
from .windows import frame_order, window_weights

ADAM = ("step", "exp_avg", "exp_avg_sq")  # what it remembers of a parameter


class Run:
    """The state of an optimization.

    The frames of the next step are loaded by a thread of their own while this one works. Several processes share every
    batch and step alike. Texture and pictures lie on the process's device, frames in the computer's memory until a step
    shows them.

    Attributes:
        step: steps done.
        texture: what is optimized.
        last_image: (3, H, W) sRGB, the latest batch's first frame as rendered.
    """

    def __init__(
        self,
        dataset: Dataset,
        ensemble: DetectorEnsemble,
        settings: OptimizerSettings,
        processes: Processes = SINGLE_PROCESS,
    ) -> None:
        if settings.batch < processes.size:
            told = f"batch: {settings.batch} frames for {processes.size} processes"
            raise RaucaError(f"{told}; give one to each at least")
        self.settings, self.ensemble, self.processes = settings, ensemble, processes
        self.store = frame_store(dataset, settings, processes.device)
        self.texture: Texture = make_texture(self.store, settings, processes.device)
        self.adam = torch.optim.Adam([self.texture.parameter], lr=settings.lr, fused=True)
        self.smooth = smooth_paint(self.texture, self.store, settings)
        self.prior = prior(self.texture, dataset, self.store, settings)
        # Detectors that take turns do not lose sight of the same frames: each has an order of its own.
        seeds = [settings.seed, *(named_seed(settings.seed, "turn", k) for k in range(1, ensemble.turns))]
        seeds = seeds if settings.turns else seeds[:1]
        self.orders = [frame_order(self.store.frames, settings, seed, len(self.store)) for seed in seeds]
        self.identity = {
            **settings.identity(),
            "detectors": ensemble.identity,
            "frames": _digest(dataset, self.store),
            "taps": TAP_FORMAT,
            "processes": processes.size,
        }
        self.step, self.last_image = 0, torch.zeros(3, 1, 1)
        self._loader = ThreadPoolExecutor(1, "frames")
        self._next: list[int] = []
        self._loading: Future[list[ReadyFrame]] | None = None

    @property
    def order(self) -> FrameOrder:
        """That the next step's frames are of."""
        return self.orders[self.step % len(self.orders)]

    def advance(self) -> StepReport:
        """Take one step of Eq. 8 on the step's own frames and augmentation."""
        begin, watch = time.perf_counter(), Stopwatch()
        with watch.time("load"):
            drawn, batch = self._take()
        with threads(1):
            images = self._render(batch, watch)
            with watch.time("augmentation"):
                seen, boxes = self._augment(images, boxes_of(batch))
        # Backward passes are cut at the images: the detectors' share can be timed, and a bad frame named.
        with watch.time("detector"):
            found = self._weighed(drawn, self._attack(seen, boxes, batch))
        with threads(1):
            smooth, extra = self._descend(images, seen, found, batch, watch)
        losses, scores, smooth = self._gather(drawn, found.losses, found.scores, smooth)
        self.order.note(drawn, scores)
        self.step, self.last_image = self.step + 1, images[0].detach()
        attack, mean, settings = float(losses.mean()), float(smooth.mean()), self.settings
        loss = settings.alpha * attack + settings.beta * mean + settings.gamma * extra
        seconds = time.perf_counter() - begin
        return StepReport(
            self.step, settings.steps, loss, attack, mean, float(scores.mean()), seconds, watch.seconds, extra
        )  # fmt: skip

    def pictures(self) -> tuple[Tensor, Tensor]:
        """The UV map (3, size, size), black where nothing is paintable, and the latest frame (3, H, W), sRGB."""
        side = self.settings.map_size
        flat = torch.zeros(side**2, 3)
        flat[torch.from_numpy(self.store.pyramid.texels)] = self.texture.texels().detach().cpu()
        return flat.T.reshape(3, side, side), self.last_image

    def checkpoint(self) -> Checkpoint:
        """Everything that the next step depends on; its frames are drawn, as they load while the step before works."""
        parameter = self.texture.parameter
        tensors = {
            "parameter": parameter.detach(),
            "order": torch.cat([o.state() for o in self.orders]),
            "next": torch.tensor(self._next),
        }
        return Checkpoint(self.step, self.identity, {**tensors, **self.adam.state[parameter]})

    def restore(self, checkpoint: Checkpoint) -> None:
        """Go back to a checkpoint of the same run."""
        tensors, parameter = checkpoint.tensors, self.texture.parameter
        if set(tensors) != {"parameter", "order", "next", *ADAM} or tensors["parameter"].shape != parameter.shape:
            raise RaucaError("checkpoint: it is of another texture; start the run in a new folder")
        with torch.no_grad():
            parameter.copy_(tensors["parameter"])
        self.adam.state[parameter] = {name: tensors[name].to(parameter.device) for name in ADAM}
        for order, state in zip(self.orders, tensors["order"].tensor_split(len(self.orders)), strict=True):
            order.restore(state)
        self._prefetch(tensors["next"].tolist())
        self.step = checkpoint.step

    def close(self) -> None:
        """Stop the thread that loads frames."""
        self._loader.shutdown(wait=True, cancel_futures=True)

    def _take(self) -> tuple[list[int], list[ReadyFrame]]:
        """The frames of this step, and this process's part of them, ready; those of the next begin to load."""
        if self._loading is None:
            self._prefetch(self.order.draw(self.settings.batch))
        assert self._loading is not None
        drawn, batch = self._next, self._loading.result()
        following = self.orders[(self.step + 1) % len(self.orders)]
        self._prefetch(following.draw(self.settings.batch))
        return drawn, batch

    def _prefetch(self, frames: list[int]) -> None:
        mine = self.processes.share(frames)
        self._next = frames
        self._loading = self._loader.submit(lambda: [self.store.ready(i) for i in mine])

    def _render(self, batch: list[ReadyFrame], watch: Stopwatch) -> Tensor:
        """The batch in the texture: sRGB images (B, 3, H, W)."""
        with watch.time("taps"):
            colors = srgb_to_linear(self._painted())
            texture = MipmappedTexture(self.store.layout.taps.pyramid, colors)
            albedo = texture.sample([f.taps.rows for f in batch])
        with watch.time("environment"):
            return shade(batch, albedo)

    def _painted(self) -> Tensor:
        """The colors of this step: the texture's, a pattern moved by a random part of a tile where that is asked."""
        colors, settings = self.texture.colors(), self.settings
        if settings.paint == "pattern" and settings.shift > 0:
            side, reach = settings.pattern_side, round(settings.shift * settings.pattern_side)
            moves = named_rng(settings.seed, "shift", self.step).integers(-reach, reach, 2, endpoint=True)
            colors = colors.reshape(side, side, 3).roll(moves.tolist(), (0, 1)).reshape(-1, 3)
        return colors

    def _augment(self, images: Tensor, boxes: Tensor) -> tuple[Tensor, Tensor]:
        """What the detectors are shown of images (B, 3, H, W) and boxes (B, 4)."""
        moved, side = boxes.to(images), images.shape[-1]
        shown = self.settings.detector_size or side
        if self.settings.roa:
            ranges = RANGES[self.settings.augmentation]
            drawn = Augmentation.draw(named_rng(self.settings.seed, "roa", self.step), self.settings.batch, ranges)
            drawn = drawn.part(self.processes.rank, self.processes.size)
            if ranges.zoom:
                drawn = drawn.zoomed(boxes, side, shown, ranges)
            images, moved = drawn(images, moved)
        # Moved first: what is drawn nearer shows the detail that the frame has.
        if shown != side:
            moved = moved * (shown / side)
            images = functional.interpolate(
                images, size=(shown, shown), mode="bilinear", antialias=True, align_corners=False
            )
        return images, moved

    def _attack(self, seen: Tensor, boxes: Tensor, batch: list[ReadyFrame]) -> Attacked:
        """The detectors' losses and gradient; what is not finite is told by its frame."""
        try:
            found = self.ensemble.attack(seen, boxes, self.step if self.settings.turns else None)
        except RaucaError as error:  # a detector counts places in the batch, which nobody knows
            for frame, image in zip(batch, seen, strict=True):
                if not torch.isfinite(image).all():
                    raise RaucaError(
                        f"step {self.step + 1}: the picture of frame {frame.frame.id} is not finite; "
                        "look at its light maps, then render the frame again or remove it"
                    ) from error
            raise
        fine = torch.isfinite(found.losses) & torch.isfinite(found.gradient.flatten(1).sum(1))
        bad = [frame.frame.id for frame, ok in zip(batch, fine.tolist(), strict=True) if not ok]
        if self.processes.any(bool(bad)):
            named = f"on frame {bad[0]}" if bad else "in another process"
            raise RaucaError(
                f"step {self.step + 1}: the loss or its gradient is not finite {named}; "
                "check the detector's weights, then remove the frame"
            )
        return found

    def _weighed(self, drawn: list[int], found: Attacked) -> Attacked:
        """Losses and gradient, times what each frame counts in its window."""
        if self.settings.window == 1:
            return found
        (every,) = self._gather(drawn, found.losses)
        counts = window_weights(every, self.settings.window, self.settings.window_temperature)
        mine = counts[self.processes.rank :: self.processes.size].to(found.losses)
        return replace(found, losses=found.losses * mine, gradient=found.gradient * mine[:, None, None, None])

    def _descend(
        self, images: Tensor, seen: Tensor, found: Attacked, batch: list[ReadyFrame], watch: Stopwatch
    ) -> tuple[Tensor, float]:
        """Carry the images' gradient to the texture and step; returns Eq. 7 for each image (b,), and the prior."""
        parameter, settings = self.texture.parameter, self.settings
        with watch.time("backward"):
            share = 1.0 if self.processes.is_main else 0.0  # gradients add up over the processes
            if self.smooth is None:
                smooth = smooth_picture(images, paint_of(batch).to(images.device))
                weighted = [smooth.sum() * (settings.beta / settings.batch)]
            else:
                smooth = self.smooth()
                weighted = [smooth * (settings.beta * share)]
            extra = None if self.prior is None else self.prior()
            weighted += [] if extra is None else [extra * (settings.gamma * share)]
            self.adam.zero_grad(set_to_none=True)
            torch.autograd.backward(
                [seen, *weighted], [found.gradient * (settings.alpha / settings.batch), *[None] * len(weighted)]
            )
            assert parameter.grad is not None
            self.processes.sum(parameter.grad)
        with watch.time("adam"):
            if not torch.isfinite(parameter.grad.sum()):  # a sum is finite only if all are, and ten times as fast
                names = ", ".join(f.frame.id for f in batch)
                raise RaucaError(
                    f"step {self.step + 1}: the UV map's gradient is not finite on frames {names}; remove them"
                )
            self.adam.param_groups[0]["lr"] = self.settings.lr_at(self.step)
            self.adam.step()
            self.texture.after_step()
        return smooth.detach().expand(len(batch)), 0.0 if extra is None else float(extra.detach())

    def _gather(self, drawn: list[int], *mine: Tensor) -> Tensor:
        """Values of this process's part of the batch, (b,) each, as those of the whole batch (len(mine), B)."""
        every = torch.zeros(len(mine), len(drawn), device=self.processes.device)
        every[:, self.processes.rank :: self.processes.size] = torch.stack(mine)
        return self.processes.sum(every).cpu()


def _digest(dataset: Dataset, store: FrameStore) -> str:
    """Names the data: plan, geometry and the list of frames."""
    plan: dict[str, Any] = dataset.plan.to_json()
    text = json.dumps([plan, store.vehicle.geometry_id, [f.id for f in store.frames]], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]
