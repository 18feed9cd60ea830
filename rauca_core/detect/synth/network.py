"""What the training loop and the adapter ask of a network, whatever its family."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor, nn

from ..interface import DensePredictions


@dataclass(frozen=True, eq=False)
class Truth:
    """What there is to find in an image.

    Attributes:
        boxes: (T, 4) float32 xyxy, pixels.
        labels: (T,) int64 indices into the class names.
    """

    boxes: Tensor
    labels: Tensor

    def to(self, device: torch.device) -> Truth:
        """The same on a device."""
        return Truth(self.boxes.to(device), self.labels.to(device))


class Trainable(Protocol):
    """A module that detects and learns to; images are square sRGB batches (B, 3, S, S) in [0, 1]."""

    @property
    def backbone(self) -> nn.Module:
        """The pre-trained convolutions, which learn more slowly than the rest."""
        ...

    def losses(self, images: Tensor, truths: Sequence[Truth]) -> dict[str, Tensor]:
        """Scalar losses by name, to be summed."""
        ...

    def dense(self, images: Tensor) -> DensePredictions:
        """Predictions before non-maximum suppression, boxes in the images' pixels; gradients flow to ``images``."""
        ...
