"""What an extractor learns from: the items of an epoch, their loss, and how it lights a frame.

The published extractor has two training loops; what differs is how often they render and infer (paper, Fig. 4).

*Base*: every color of every frame is an item of its own: x_nr is rendered online, the network infers, both anew.
*Final*: x_nr comes from a set rendered offline, once per camera and color, that weathers and locations share; one
inference of the network serves all colors of a frame.

The truth of both is the frame in the color, from its exact light maps, masked like the reference image.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor, nn

from ..contract import RaucaError
from ..contract.color import TRAIN, Color
from ..environment.extractor import LightSplitter
from ..environment.frames import LightFrame, LightFrames, shrink
from ..environment.losses import light_loss, weighted_bce, weighted_mse
from ..environment.methods import Render, published_render, splitter_render
from ..environment.metrics import albedos
from ..environment.published import PublishedEfe, fuse_published
from ..render import linear_to_srgb
from .light_batches import Batch, augment, collate, crop, draw_albedos, join
from .settings import ExtractorSettings


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

    def render_of(self, net: nn.Module, index: int, frame: LightFrame) -> Render:
        """The frame as the extractor lights it with the weights of ``net``."""


class SplitterLearner:
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

    def render_of(self, net: nn.Module, index: int, frame: LightFrame) -> Render:
        assert isinstance(net, LightSplitter)
        return splitter_render(net, frame)


class _Published:
    """What both loops share."""

    def __init__(
        self,
        net: PublishedEfe,
        frames: LightFrames,
        settings: ExtractorSettings,
        colors: Sequence[Color] = TRAIN,
    ) -> None:
        self.net = net
        self._frames = frames
        self._weighted = settings.weighted
        self._loss = weighted_bce if settings.loss == "bce" else weighted_mse
        self._albedos = albedos(colors)
        self._colors_srgb = linear_to_srgb(self._albedos)

    def render_of(self, net: nn.Module, index: int, frame: LightFrame) -> Render:
        assert isinstance(net, PublishedEfe)
        return published_render(net, frame, self._frames.plain(index))

    def _batch(self, items: Sequence[Item]) -> Batch:
        device = next(self.net.parameters()).device
        return collate([self._frames.get(item.frame) for item in items]).to(device)

    def _truth(self, batch: Batch, albedo: Tensor) -> Tensor:
        """Masked frames in a color per frame; albedo (B, 3, 1, 1)."""
        return linear_to_srgb(batch.A * albedo.to(batch.A) + batch.B) * batch.vehicle


class BaseLearner(_Published):
    """The loop of the paper's base version."""

    def items(self, frames: Sequence[int]) -> list[Item]:
        return [Item(i, color) for i in frames for color in range(len(self._albedos))]

    def loss(self, net: nn.Module, items: Sequence[Item], draw: Draw) -> Tensor:
        batch, colors = self._batch(items), [item.color for item in items]
        rendered = [self._frames.render_plain(i.frame).x_nr(self._colors_srgb[i.color]) for i in items]
        A, B = net(batch.image * batch.vehicle)
        x_ren = fuse_published(torch.stack(rendered).to(A.device), A, B)
        return self._loss(x_ren, self._truth(batch, self._albedos[colors]), batch.vehicle, self._weighted)


class FinalLearner(_Published):
    """The loop of the paper's final version."""

    def items(self, frames: Sequence[int]) -> list[Item]:
        return [Item(i) for i in frames]

    def loss(self, net: nn.Module, items: Sequence[Item], draw: Draw) -> Tensor:
        batch = self._batch(items)
        offline = [self._frames.plain(item.frame) for item in items]
        A, B = net(batch.image * batch.vehicle)
        losses = []
        for albedo, color in zip(self._albedos, self._colors_srgb, strict=True):
            x_nr = torch.stack([plain.x_nr(color) for plain in offline]).to(A.device)
            truth = self._truth(batch, albedo[None])
            losses.append(self._loss(fuse_published(x_nr, A, B), truth, batch.vehicle, self._weighted))
        return torch.stack(losses).mean()
