"""Losses on the paint itself and on the picture it makes: smoothness, and closeness to colors or to a seed picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..contract import RaucaError
from .frames import FrameStore, ReadyFrame
from .losses import SmoothLoss, log_loss
from .naturalness.lab import delta_e, lab
from .naturalness.texture import NaturalColors
from .settings import OptimizerSettings
from .texture import PaintedPanels, Texture

PaintLoss = Callable[[Texture], Tensor]
LINES, BETWEEN = 0.9, 0.1  # DAS's weights of the seed picture on its lines and off them


def smooth_picture(images: Tensor, paint: Tensor) -> Tensor:
    """Eq. 7 on the rendered picture: squared differences of neighbors, divided by H * W, one loss per image (B,).

    A pair counts when both pixels show paint.

    Args:
        images: (B, 3, H, W) sRGB.
        paint: (B, H, W) bool.
    """
    across = (images[..., 1:] - images[..., :-1]).square().sum(1) * (paint[..., 1:] & paint[..., :-1])
    down = (images[..., 1:, :] - images[..., :-1, :]).square().sum(1) * (paint[:, 1:] & paint[:, :-1])
    return (across.sum((1, 2)) + down.sum((1, 2))) / (images.shape[2] * images.shape[3])


def paint_of(batch: Sequence[ReadyFrame]) -> Tensor:
    """Pixels at least half of which are paint: (B, H, W) bool."""
    width, height = batch[0].taps.width, batch[0].taps.height
    mask = np.zeros((len(batch), height * width), bool)
    for row, frame in zip(mask, batch, strict=True):
        row[frame.taps.pixels[frame.taps.alpha >= 0.5]] = True
    return torch.from_numpy(mask.reshape(-1, height, width))


def smooth_pattern(pattern: Tensor) -> Tensor:
    """ACTIVE's Eq. 5 on a square pattern (side, side, 3): ``-log(1 - |difference|)`` of neighbors, their mean.

    |.| of colors is the mean over the channels.
    """
    steps = (pattern[1:, :-1] - pattern[:-1, :-1], pattern[:-1, 1:] - pattern[:-1, :-1])
    return torch.stack([log_loss(step.abs().mean(-1)).sum() for step in steps]).sum() / (len(pattern) - 1) ** 2


def near_palette(colors: Tensor, palette: Tensor) -> Tensor:
    """ACTIVE's Eq. 6: ``-log(1 - |distance|)`` of each color (N, 3) to the nearest of a palette (K, 3), the mean."""
    distance = (colors[:, None] - palette[None]).abs().mean(-1)
    return log_loss(distance.amin(1)).mean()


def near_seed(colors: Tensor, seed: Tensor, edges: Tensor) -> Tensor:
    """DAS's content loss: squared distance from the seed picture (M, 3), summed, lines (M,) nine times as dear."""
    weight = BETWEEN + (LINES - BETWEEN) * edges
    return ((colors - seed).square().sum(1) * weight).sum()


class NearReference:
    """Mean CIE 1976 distance of the paint from a reference, over the vehicle's surface, in hundreds."""

    def __init__(self, reference_srgb: Tensor, areas: Tensor) -> None:
        """``reference_srgb`` (P, 3) in [0, 1]; ``areas`` (P,) of the texels."""
        self._reference, self._share = lab(reference_srgb), areas / areas.sum() / 100

    def __call__(self, texels: Tensor) -> Tensor:
        """Texels (P, 3) sRGB -> scalar."""
        return (delta_e(lab(texels), self._reference.to(texels)) * self._share.to(texels)).sum()


def smooth_paint(store: FrameStore, settings: OptimizerSettings) -> PaintLoss | None:
    """The smoothness loss on the paint; None where it is taken on the picture."""
    if settings.smooth == "picture":
        return None
    if settings.smooth == "pattern":
        side = settings.pattern_side
        _require(settings.paint == "pattern", "smooth: pattern", "paint: pattern")
        return lambda texture: smooth_pattern(texture.colors().reshape(side, side, 3))
    smooth = SmoothLoss(store.pyramid.texels, settings.map_size)
    return lambda texture: smooth(texture.texels())


def prior(texture: Texture, settings: OptimizerSettings, palette: Callable[[], Any]) -> PaintLoss | None:
    """The second loss on the paint.

    Args:
        palette: makes the background's colors (K, 3) sRGB, where they are asked for.

    Raises:
        RaucaError: the prior of a seed picture, or of a reference, for a texture without one.
    """
    if settings.prior == "background":
        colors = torch.from_numpy(palette())
        return lambda texture: near_palette(texture.colors(), colors.to(texture.parameter.device))
    if settings.prior == "seed":
        _require(isinstance(texture, PaintedPanels), "prior: seed", "cover: panels")
        return lambda texture: near_seed(texture.free(), texture.seed, texture.edges)  # type: ignore[attr-defined]
    if settings.prior == "reference":
        near = _near_reference(texture)
        _require(near is not None, "prior: reference", "a --reference")
        return lambda texture: near(texture.texels())  # type: ignore[misc]
    return None


def _near_reference(texture: Texture) -> NearReference | None:
    if not isinstance(texture, NaturalColors) or texture.constraints.reference is None:
        return None
    reference, areas = texture.constraints.reference / 255.0, texture.constraints.points.areas
    return NearReference(torch.from_numpy(reference).float(), torch.from_numpy(areas).float())


def _require(fits: bool, what: str, needed: str) -> None:
    if not fits:
        raise RaucaError(f"{what} needs {needed}; choose another {what.split(':')[0]}")
