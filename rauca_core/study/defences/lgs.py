"""Local gradients smoothing (Naseer, Khan, Porikli, WACV 2019): darken where gradients crowd.

An adversarial patch is a dense heap of strong gradients. The image's gradient magnitudes, scaled to [0, 1], are
averaged over overlapping blocks; in blocks above a threshold every pixel is darkened in proportion to its own gradient.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import torch
from pydantic import Field, ValidationInfo, field_validator
from torch import Tensor
from torch.nn import functional

from .interface import Defence

SOFTNESS = 0.02  # of the smooth threshold, in normalized gradient


class LocalGradientsSmoothing(Defence):
    """LGS with the paper's parameters. Differentiable; the choice of blocks counts as constant.

    The paper leaves three things open. Color: squared differences are summed over the channels. Overlaps: a pixel is
    smoothed when any of its blocks is above the threshold. Edges: the last row and column of blocks end with the image.

    Attributes:
        block: side of a block, pixels (k); all of the image's side where that is shorter.
        overlap: of neighboring blocks, pixels (o).
        threshold: on a block's mean normalized gradient (gamma).
        smoothing: factor on the gradient (lambda).
    """

    kind: ClassVar[str] = "lgs"
    block: int = Field(15, ge=1)
    overlap: int = Field(5, ge=0)
    threshold: float = Field(0.1, ge=0, le=1)
    smoothing: float = Field(2.3, ge=0)

    @field_validator("overlap")
    @classmethod
    def _less_than_a_block(cls, overlap: int, others: ValidationInfo) -> int:
        if overlap >= others.data.get("block", overlap + 1):
            raise ValueError("must be less than block")
        return overlap

    def _defend(self, images: Tensor) -> Tensor:
        """Darkened where gradients crowd: I * (1 - clip(lambda * g', 0, 1))."""
        return self._darkened(images, lambda mean: mean.detach() > self.threshold)

    def stand_in(self, images: Tensor) -> Tensor:
        """The same with a smooth choice of blocks, so that the attack may leave a block below the threshold."""
        return self._darkened(images, lambda mean: ((mean - self.threshold) / SOFTNESS).sigmoid())

    def _darkened(self, images: Tensor, crowded: Callable[[Tensor], Tensor]) -> Tensor:
        gradient = normalized_gradient(images)
        return images * (1 - (self.smoothing * gradient * self._crowded_blocks(gradient, crowded)).clamp(0, 1))

    def _crowded_blocks(self, gradient: Tensor, crowded: Callable[[Tensor], Tensor]) -> Tensor:
        """(B, 1, H, W) gradient -> ``crowded`` of a block's mean at the block's pixels, 1 or 0; the most of several."""
        height, width = gradient.shape[2:]
        block = (min(self.block, height), min(self.block, width))
        rows, columns = (self._starts(size, side) for size, side in zip((height, width), block, strict=True))
        means = functional.avg_pool2d(functional.avg_pool2d(gradient, (block[0], 1), 1), (1, block[1]), 1)
        chosen = torch.zeros_like(means)
        at = (..., rows[:, None], columns)
        chosen[at] = crowded(means[at]).to(means)
        # A pixel's blocks start up to a block's side before it.
        before = functional.pad(chosen, (block[1] - 1, block[1] - 1, block[0] - 1, block[0] - 1))
        return functional.max_pool2d(functional.max_pool2d(before, (block[0], 1), 1), (1, block[1]), 1)

    def _starts(self, size: int, block: int) -> Tensor:
        """First pixels of the blocks along an axis."""
        stride = max(1, block - self.overlap)
        last = size - block
        return torch.arange(0, last + stride, stride).clamp(max=last)


def normalized_gradient(images: Tensor) -> Tensor:
    """First-order gradient magnitude of (B, 3, H, W), scaled per image to [0, 1] -> (B, 1, H, W); 0 where it is flat.

    Forward differences; none across the last row and column.
    """
    dx = functional.pad(images.diff(dim=3), (0, 1, 0, 0))
    dy = functional.pad(images.diff(dim=2), (0, 0, 0, 1))
    squared = (dx.square() + dy.square()).sum(dim=1, keepdim=True)
    # The root's slope is infinite at 0: flat pixels take a detour whose gradient is 0.
    magnitude = torch.where(squared > 0, squared, 1).sqrt() * (squared > 0)
    low, high = magnitude.amin((2, 3), keepdim=True), magnitude.amax((2, 3), keepdim=True)
    span = high - low
    return (magnitude - low) / torch.where(span > 0, span, 1)
