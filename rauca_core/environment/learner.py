"""What an extractor learns from: the items of an epoch, their loss, and how it lights a frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor, nn

from ..contract import RaucaError
from .batches import Batch, augment, collate, crop, draw_albedos, join
from .extractor import LightSplitter
from .frames import LightFrame, LightFrames, shrink
from .losses import light_loss
from .methods import Render, splitter_render
from .settings import TrainingSettings


class Item(NamedTuple):
    """One thing to infer on: a frame, and the number of a color where inferences are not shared by colors."""

    frame: int
    color: int = 0


Draw = Callable[[Item], np.random.Generator]
"""An item's own random stream: what is drawn for it depends neither on its batch nor on its process."""


class Learner(Protocol):
    """An extractor and its training loop, less what all loops share."""

    @property
    def net(self) -> nn.Module:
        """The network."""

    def items(self, frames: Sequence[int]) -> list[Item]:
        """What one epoch over ``frames`` goes through, in any order."""

    def loss(self, net: nn.Module, items: Sequence[Item], draw: Draw) -> Tensor:
        """Mean loss over the items. ``net`` is :attr:`net`, or its wrapper that gathers gradients of processes."""

    def render_of(self, index: int, frame: LightFrame) -> Render:
        """The frame as the extractor lights it."""


class SplitterLearner:
    """Ours: exact maps compared in albedos drawn anew at every step, one inference for all of them.

    Raises:
        RaucaError: frames that cannot be averaged down to the square's side, where they are to be mixed.
    """

    def __init__(self, net: LightSplitter, frames: LightFrames, settings: TrainingSettings) -> None:
        if settings.mixed and (settings.crop == 0 or frames.size % settings.crop):
            raise RaucaError(
                f"--mixed: frames of {frames.size} pixels, no multiple of --crop {settings.crop}; "
                "choose a --crop that divides them, or drop --mixed"
            )
        self.net = net
        self._frames, self._settings = frames, settings

    def items(self, frames: Sequence[int]) -> list[Item]:
        return [Item(i) for i in frames]

    def loss(self, net: nn.Module, items: Sequence[Item], draw: Draw) -> Tensor:
        drawn = [self._draw(item, draw(item)) for item in items]
        device = next(self.net.parameters()).device
        batch, albedo = join([b for b, _ in drawn]).to(device), torch.cat([a for _, a in drawn], 1)
        predicted = net(batch.image, batch.paint, batch.reference)
        return light_loss(predicted, (batch.A, batch.B), albedo.to(device), batch.paint, self._settings.weighted)

    def _draw(self, item: Item, rng: np.random.Generator) -> tuple[Batch, Tensor]:
        """A frame as this step sees it, and albedos (C, 1, 3, H, W) to compare it in."""
        side, frame = self._settings.crop, self._frames.get(item.frame)
        if self._settings.mixed and rng.random() < 0.5:
            frame = shrink(frame, frame.image.shape[-1] // side)
        seen = collate([frame])
        if side:
            seen = crop(seen, side, rng)
        if self._settings.augment:
            seen = augment(seen, rng)
        height, width = seen.image.shape[-2:]
        return seen, draw_albedos(rng, self._settings.colors, 1, height, width)

    def render_of(self, index: int, frame: LightFrame) -> Render:
        return splitter_render(self.net, frame)
