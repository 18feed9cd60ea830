"""The published extractor's two training loops; what differs is how often they render and infer (paper, Fig. 4).

*Base*: every color of every frame is an item of its own: x_nr is rendered online, the network infers, both anew.
*Final*: x_nr comes from a set rendered offline, once per camera and color, that weathers and locations share; one
inference of the network serves all colors of a frame.

The truth of both is the frame in the color, from its exact light maps, masked like the reference image.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from ..contract.color import TRAIN, Color
from ..render import linear_to_srgb
from .batches import Batch, collate
from .frames import LightFrame, LightFrames
from .learner import Draw, Item
from .losses import weighted_bce, weighted_mse
from .methods import Render, published_render
from .metrics import albedos
from .published import PublishedEfe, fuse_published
from .settings import TrainingSettings


class _Published:
    """What both loops share."""

    def __init__(
        self,
        net: PublishedEfe,
        frames: LightFrames,
        settings: TrainingSettings,
        colors: Sequence[Color] = TRAIN,
    ) -> None:
        self.net = net
        self._frames = frames
        self._weighted = settings.weighted
        self._loss = weighted_bce if settings.loss == "bce" else weighted_mse
        self._albedos = albedos(colors)
        self._colors_srgb = linear_to_srgb(self._albedos)

    def render_of(self, index: int, frame: LightFrame) -> Render:
        return published_render(self.net, frame, self._frames.plain(index))

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
