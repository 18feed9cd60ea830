"""From a head's encodings to boxes: SSD's center-size code."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from .layers import Array

# exp(10) anchors are wider than any image; beyond that only the gradient would be lost to infinity
MAX_LOG_SIZE = 10.0


class CenterSizeBoxes(nn.Module):
    """Decodes offsets from anchors (Liu et al. 2016, SSD, eq. 2).

    Everything is relative to the image's width and height.
    """

    def __init__(self, anchors: Array, variances: Array, rows_first: bool) -> None:
        """Take what all images share.

        Args:
            anchors: (N, 4) center x, y, width, height.
            variances: (4,) factors on the encoded x, y, width, height.
            rows_first: encodings are y, x, height, width (TensorFlow) instead of x, y, width, height (caffe).
        """
        super().__init__()
        order = [1, 0, 3, 2] if rows_first else [0, 1, 2, 3]
        scale = variances * anchors[:, [2, 3, 2, 3]]
        scale[:, 2:] = variances[2:]
        self.order: Tensor
        self.register_buffer("order", torch.tensor(order), persistent=False)
        self.scale = nn.Parameter(torch.from_numpy(scale).float(), requires_grad=False)
        self.center = nn.Parameter(torch.from_numpy(anchors[:, :2]).float(), requires_grad=False)
        self.size = nn.Parameter(torch.from_numpy(anchors[:, 2:]).float(), requires_grad=False)

    def forward(self, encodings: Tensor) -> Tensor:
        """(B, N, 4) encodings -> (B, N, 4) xyxy."""
        offset, log_size = (encodings[..., self.order] * self.scale).split(2, -1)
        center = self.center + offset
        half = log_size.clamp(max=MAX_LOG_SIZE).exp() * (self.size / 2)
        return torch.cat([center - half, center + half], -1)
