"""What our networks share: the backbone that they begin with, and the truth that they learn from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor, nn

from ..darknet import read_weights
from ..darknet_network import Convolution, DarknetNetwork, run

STRIDES = (8, 16, 32)
TAPS = (16, 24, 27)
"""Layers of ``yolov4-tiny.cfg`` whose outputs have :data:`STRIDES`."""
CHANNELS = (256, 512, 256)
STEM = 8
"""Layers before the first of stride 8: edges and colors, which hold for any image and stay as they were trained."""


class DarknetBackbone(nn.Module):
    """YOLOv4-tiny up to its first head: sRGB images (B, 3, H, W) in [0, 1] -> features of stride 8, 16 and 32.

    Batch normalization is folded into the convolutions, so it is frozen, as usual when detectors are fine-tuned on
    small batches.

    Attributes:
        layers: the cfg's, of which only those behind the stem learn.
    """

    def __init__(self, cfg: Path, weights: Path | None = None) -> None:
        """Build it, empty or with a darknet weights file.

        Raises:
            RaucaError: anything wrong with the files.
        """
        super().__init__()
        network = DarknetNetwork(cfg)
        if weights is not None:
            read_weights(weights, network)
        self.layers = network.layers[: TAPS[-1] + 1]
        for layer in self.layers[STEM + 1 :]:
            if isinstance(layer, Convolution):
                layer.weight.requires_grad_(True)
                layer.bias.requires_grad_(True)

    def forward(self, images: Tensor) -> list[Tensor]:
        """Features (B, C, H / stride, W / stride) for each of :data:`STRIDES`."""
        return run(self.layers, images, TAPS)[1]


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
