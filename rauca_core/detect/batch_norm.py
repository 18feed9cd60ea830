"""Batch normalization that is a scale and a shift, for networks that no longer learn.

Beside saving time this goes around a fault of torch's CPU kernels (seen in 2.13, any type and size): with a batch of
one, the backward pass of BatchNorm2d misreads a gradient whose channels come last in memory, as those of a feature map
that a transformer flattened. The gradient with respect to the image is then finite, plausible and wrong.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn


class FrozenBatchNorm(nn.Module):
    """``x * scale + shift`` per channel, as :class:`torch.nn.BatchNorm2d` computes in evaluation mode."""

    scale: Tensor
    shift: Tensor

    def __init__(self, norm: nn.BatchNorm2d) -> None:
        super().__init__()
        if norm.running_mean is None or norm.running_var is None:
            raise ValueError("a BatchNorm without running statistics cannot be frozen")
        with torch.no_grad():
            scale = (norm.running_var + norm.eps).rsqrt()
            shift = -norm.running_mean * scale
            if norm.affine:
                scale, shift = scale * norm.weight, shift * norm.weight + norm.bias
        self.register_buffer("scale", scale[:, None, None].clone())
        self.register_buffer("shift", shift[:, None, None].clone())

    def forward(self, x: Tensor) -> Tensor:
        return x * self.scale + self.shift


def freeze_batch_norms(network: nn.Module) -> nn.Module:
    """Replace every BatchNorm2d inside ``network`` by what it computes; returns the network, in evaluation mode."""
    for parent in list(network.modules()):
        for name, child in list(parent.named_children()):
            if isinstance(child, nn.BatchNorm2d) and child.track_running_stats:
                setattr(parent, name, FrozenBatchNorm(child))
    return network.eval()
