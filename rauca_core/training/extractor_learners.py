"""What an extractor learns from: the items of an epoch, their loss, and how it lights a frame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from ..contract import RaucaError
from ..contract.color import TRAIN, Color
from ..environment.extractor import LightSplitter, PublishedEfe, fuse_published
from ..environment.frames import LightFrame, LightFrames, shrink
from ..environment.losses import light_loss, weighted_bce
from ..environment.methods import Render, published_render, splitter_render
from ..environment.metrics import albedos
from ..render import linear_to_srgb
from .light_batches import Shown, augment, collate, crop, draw_albedos, shown
from .settings import ExtractorSettings

COLORS = 6  # albedos that one inference of ours is compared in


class Item(NamedTuple):
    """One thing to infer on: a frame, and the number of a color where inferences are not shared by colors."""

    frame: int
    color: int = 0


Draw = Callable[[Item], np.random.Generator]
"""An item's own random stream: what is drawn for it depends neither on its batch nor on its process."""


class Learner(ABC):
    """An extractor and its training loop, less what all loops share.

    Attributes:
        net: the network.
    """

    def __init__(self, net: nn.Module, frames: LightFrames, settings: ExtractorSettings) -> None:
        self.net, self._frames, self._settings = net, frames, settings

    @property
    def device(self) -> torch.device:
        return next(self.net.parameters()).device

    def items(self, frames: Sequence[int]) -> list[Item]:
        """What one epoch over ``frames`` goes through, in any order."""
        return [Item(i) for i in frames]

    @abstractmethod
    def loss(self, net: nn.Module, items: Sequence[Item], draw: Draw) -> Tensor:
        """Mean loss over the items. ``net`` is :attr:`net`, or its wrapper that gathers gradients of processes."""

    @abstractmethod
    def render_of(self, net: Any, index: int, frame: LightFrame) -> Render:
        """The frame as the extractor lights it with the weights of ``net``."""


class SplitterLearner(Learner):
    """Ours: exact maps compared in albedos drawn anew at every step, one inference for all of them.

    Raises:
        RaucaError: frames that cannot be averaged down to the square's side, where they are to be mixed.
    """

    def __init__(self, net: LightSplitter, frames: LightFrames, settings: ExtractorSettings) -> None:
        if settings.mixed and (settings.crop == 0 or frames.size % settings.crop):
            raise RaucaError(
                f"--mixed: frames of {frames.size} pixels, no multiple of --crop {settings.crop}; "
                "choose a --crop that divides them, or drop --mixed"
            )
        super().__init__(net, frames, settings)

    def loss(self, net: nn.Module, items: Sequence[Item], draw: Draw) -> Tensor:
        drawn = [self._draw(item, draw(item)) for item in items]
        batch = collate([frame for frame, _ in drawn]).to(self.device)
        albedo = torch.stack([albedo for _, albedo in drawn], 1).to(self.device)
        predicted = net(batch.image, batch.paint, batch.reference)
        return light_loss(predicted, (batch.A, batch.B), albedo, batch.paint, self._settings.weighted)

    def _draw(self, item: Item, rng: np.random.Generator) -> tuple[Shown, Tensor]:
        """A frame as this step sees it, and albedos (C, 3, H, W) to compare it in."""
        side, frame = self._settings.crop, self._frames.get(item.frame)
        if self._settings.mixed and rng.random() < 0.5:
            frame = shrink(frame, frame.image.shape[-1] // side)
        seen = shown(frame)
        if side:
            seen = crop(seen, side, rng)
        if self._settings.augment:
            seen = augment(seen, rng)
        return seen, draw_albedos(rng, COLORS, *seen.image.shape[-2:])

    def render_of(self, net: LightSplitter, index: int, frame: LightFrame) -> Render:
        return splitter_render(net, frame)


class PublishedLearner(Learner):
    """What both loops of the paper share: Eq. 5 on frames in given colors."""

    def __init__(
        self, net: PublishedEfe, frames: LightFrames, settings: ExtractorSettings, colors: Sequence[Color] = TRAIN
    ) -> None:
        super().__init__(net, frames, settings)
        self._albedos = albedos(colors)
        self._colors_srgb = linear_to_srgb(self._albedos)

    def render_of(self, net: PublishedEfe, index: int, frame: LightFrame) -> Render:
        return published_render(net, frame, self._frames.plain(index))

    def _batch(self, items: Sequence[Item]) -> Shown:
        return collate([shown(self._frames.get(item.frame)) for item in items]).to(self.device)

    def _against_truth(self, rendered: Sequence[Tensor], A: Tensor, B: Tensor, batch: Shown, albedo: Tensor) -> Tensor:
        """The loss of x_nr, fused, against the frames' own light in a color per frame, masked; albedo (B, 3, 1, 1)."""
        truth = linear_to_srgb(batch.A * albedo.to(batch.A) + batch.B) * batch.vehicle
        return weighted_bce(fuse_published(torch.stack(list(rendered)).to(A.device), A, B), truth, batch.vehicle)


class FinalLearner(PublishedLearner):
    """The loop of the paper's final version: x_nr comes from a set rendered offline, once per camera and color, that
    weathers and locations share; one inference of the network serves all colors of a frame (Fig. 4).

    The truth is the frame in the color, from its exact light maps, masked like the reference image.
    """

    def loss(self, net: nn.Module, items: Sequence[Item], draw: Draw) -> Tensor:
        batch = self._batch(items)
        offline = [self._frames.plain(item.frame) for item in items]
        A, B = net(batch.image * batch.vehicle)
        colors = zip(self._albedos, self._colors_srgb, strict=True)
        losses = [self._against_truth([p.x_nr(c) for p in offline], A, B, batch, a[None]) for a, c in colors]
        return torch.stack(losses).mean()
