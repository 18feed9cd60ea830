"""Losses on the paint itself and on the picture it makes: smoothness, and closeness to colors or to a seed picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..contract import Dataset, RaucaError
from ..contract.seeding import named_rng
from ..runtime.images import read_image
from ..runtime.kernels import njit
from .frames import FrameStore, ReadyFrame
from .losses import attack_loss
from .naturalness.colors import delta_e, lab
from .naturalness.palette import cluster
from .naturalness.texture import NaturalColors
from .settings import OptimizerSettings
from .texture import PaintedPanels, Texture

PaintLoss = Callable[[], Tensor]
"""On a texture as it is."""
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
    return torch.stack([attack_loss(step.abs().mean(-1)).sum() for step in steps]).sum() / (len(pattern) - 1) ** 2


def near_palette(colors: Tensor, palette: Tensor) -> Tensor:
    """ACTIVE's Eq. 6: ``-log(1 - |distance|)`` of each color (N, 3) to the nearest of a palette (K, 3), the mean."""
    distance = (colors[:, None] - palette[None]).abs().mean(-1)
    return attack_loss(distance.amin(1)).mean()


def near_seed(colors: Tensor, seed: Tensor, edges: Tensor) -> Tensor:
    """DAS's content loss: squared distance from the seed picture (M, 3), summed, lines (M,) nine times as dear."""
    weight = BETWEEN + (LINES - BETWEEN) * edges
    return ((colors - seed).square().sum(1) * weight).sum()


def near_reference(texels: Tensor, reference_lab: Tensor, areas: Tensor) -> Tensor:
    """Mean CIE 1976 distance of texels (P, 3) sRGB from CIELAB colors (P, 3), by areas (P,); in hundreds."""
    return (delta_e(lab(texels), reference_lab) * (areas / areas.sum() / 100)).sum()


def smooth_paint(texture: Texture, store: FrameStore, settings: OptimizerSettings) -> PaintLoss | None:
    """The smoothness loss on the paint; None where it is taken on the picture."""
    if settings.smooth == "picture":
        return None
    if settings.smooth == "pattern":
        side = settings.pattern_side
        if settings.paint != "pattern":
            raise RaucaError("smooth: pattern needs paint: pattern; choose another smooth")
        return lambda: smooth_pattern(texture.colors().reshape(side, side, 3))
    smooth = SmoothLoss(store.pyramid.texels, settings.map_size)
    if settings.smooth == "unclamped":
        if settings.paint != "texels" or settings.limit != "clamp" or settings.natural is not None:
            raise RaucaError("smooth: unclamped needs paint: texels and limit: clamp; choose another smooth")
        return lambda: smooth(texture.parameter)
    return lambda: smooth(texture.texels())


def prior(texture: Texture, dataset: Dataset, store: FrameStore, settings: OptimizerSettings) -> PaintLoss | None:
    """The second loss on the paint; raises :class:`RaucaError` where the texture has not what it is to be near to."""
    place = texture.parameter.device
    if settings.prior == "background":
        colors = torch.from_numpy(background_colors(dataset, store, settings.palette, settings.seed)).to(place)
        return lambda: near_palette(texture.colors(), colors)
    if settings.prior == "seed":
        if not isinstance(texture, PaintedPanels):
            raise RaucaError("prior: seed needs cover: panels; choose another prior")
        return lambda: near_seed(texture.free(), texture.seed, texture.edges)
    if settings.prior == "reference":
        if not isinstance(texture, NaturalColors) or texture.constraints.reference is None:
            raise RaucaError("prior: reference needs a --reference; choose another prior")
        given = texture.constraints.reference / 255.0, texture.constraints.points.areas
        reference, areas = (torch.from_numpy(array).float().to(place) for array in given)
        home = lab(reference)
        return lambda: near_reference(texture.texels(), home, areas)
    return None


class SmoothLoss:
    """Eq. 7 over the paintable texels of a UV map: squared differences of neighbors, divided by H * W.

    A pair counts when both texels are paintable: charts are not pulled towards gutters or towards one another.
    """

    def __init__(self, texels: NDArray[np.int64], size: int) -> None:
        """``texels`` (P,): positions ``row * size + column`` in ascending order, see ``Pyramid.texels``."""
        place = np.full(size * size, -1, np.int64)
        place[texels] = np.arange(len(texels))
        grid = np.pad(place.reshape(size, size), ((0, 1), (0, 1)), constant_values=-1)
        self._right = grid[:size, 1:].ravel()[texels]
        self._below = grid[1:, :size].ravel()[texels]
        self._scale = 1.0 / size**2

    def __call__(self, texels: Tensor) -> Tensor:
        """Texels (P, 3) sRGB -> scalar."""
        if texels.device.type == "cpu":
            return _Smooth.apply(texels, self._right, self._below, self._scale)
        total = texels.new_zeros(())
        for neighbor in (self._right, self._below):
            here = torch.from_numpy(np.flatnonzero(neighbor >= 0)).to(texels.device)
            there = torch.from_numpy(neighbor[neighbor >= 0]).to(texels.device)
            total = total + (texels[here] - texels[there]).square().sum()
        return total * self._scale


class _Smooth(torch.autograd.Function):
    """One pass over the texels gives the loss and its gradient; torch would make six."""

    @staticmethod
    def forward(ctx: Any, texels: Tensor, right: Any, below: Any, scale: float) -> Tensor:
        gradient = torch.zeros_like(texels)
        total = _squared_steps(texels.detach().contiguous().numpy(), right, below, gradient.numpy())
        ctx.save_for_backward(gradient.mul_(2 * scale))
        return texels.new_tensor(total * scale)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None, None]:
        return ctx.saved_tensors[0] * gradients[0], None, None, None


@njit(cache=True)
def _squared_steps(texels: Any, right: Any, below: Any, gradient: Any) -> float:
    total = 0.0
    for i in range(texels.shape[0]):
        for neighbor in (right[i], below[i]):
            if neighbor < 0:
                continue
            for c in range(3):
                step = texels[i, c] - texels[neighbor, c]
                total += step * step
                gradient[i, c] += step
                gradient[neighbor, c] -= step
    return total


FRAMES, PIXELS = 64, 512  # looked at for the background's colors, and of each


def background_colors(dataset: Dataset, store: FrameStore, count: int, seed: int) -> NDArray[np.float32]:
    """The ``count`` dominant colors (count, 3) sRGB of what is not vehicle, darkest first.

    Frames and pixels are drawn by name of the seed: a resumed run, or another process, finds the same.

    Raises:
        RaucaError: a frame's picture is missing or damaged.
    """
    rng, found = named_rng(seed, "background"), []
    for index in rng.permutation(len(store.frames))[:FRAMES]:
        folder = dataset.frame_folder(store.frames[int(index)].id)
        image, vehicle = read_image(folder / "image.png"), read_image(folder / "vehicle.png")
        around = image.reshape(-1, 3)[vehicle.reshape(len(image) * image.shape[1], -1)[:, 0] == 0]
        if len(around):
            found.append(around[rng.integers(0, len(around), PIXELS)])
    pixels = np.concatenate(found) if found else np.full((1, 3), 128)
    return cluster(pixels / 255.0, count, rng).astype(np.float32)
