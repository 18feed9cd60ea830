"""From a head's feature map to boxes, objectness and class probabilities.

Boxes are xyxy in pixels of the network's input.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from .interface import DensePredictions

# A box cannot be exp(8) = 2981 times its anchor; beyond, exp() would reach infinity and its gradient NaN.
MAX_LOG_SIZE = 8.0


def precise(x: Tensor) -> Tensor:
    """At least float32: in half precision a box 400 pixels from the origin would jump in steps of two."""
    return x.float() if x.dtype in (torch.float16, torch.bfloat16) else x


class Head(nn.Module):
    """Decode (B, anchors * (5 + classes), h, w); predictions run over anchors, then rows, then columns.

    Args:
        anchors: (A, 2) width and height, pixels of the network's input or grid cells, see ``anchors_in_cells``.
        scale_x_y: YOLOv4's stretch of the center's sigmoid about 0.5.
        anchors_in_cells: anchors (and box sizes) are counted in grid cells, as in YOLOv2.
        softmax: classes exclude each other, as in YOLOv2; otherwise each has a sigmoid of its own.
    """

    anchors: Tensor

    def __init__(self, anchors: Tensor, classes: int, scale_x_y: float, anchors_in_cells: bool, softmax: bool) -> None:
        super().__init__()
        self.register_buffer("anchors", anchors, persistent=False)
        self.classes = classes
        self.scale_x_y = scale_x_y
        self.anchors_in_cells = anchors_in_cells
        self.softmax = softmax

    def forward(self, features: Tensor, input_height: int, input_width: int) -> DensePredictions:
        batch, _, rows, columns = features.shape
        x = precise(features).view(batch, len(self.anchors), 5 + self.classes, rows, columns).permute(0, 1, 3, 4, 2)
        stride = torch.tensor([input_width / columns, input_height / rows], dtype=x.dtype, device=x.device)
        grid_y, grid_x = torch.meshgrid(
            torch.arange(rows, dtype=x.dtype, device=x.device),
            torch.arange(columns, dtype=x.dtype, device=x.device),
            indexing="ij",
        )
        offset = x[..., 0:2].sigmoid() * self.scale_x_y - 0.5 * (self.scale_x_y - 1)
        center = (offset + torch.stack([grid_x, grid_y], -1)) * stride
        anchors = self.anchors.to(x.dtype) * (stride if self.anchors_in_cells else 1.0)
        half = 0.5 * x[..., 2:4].clamp(max=MAX_LOG_SIZE).exp() * anchors[:, None, None, :]
        classes = x[..., 5:].softmax(-1) if self.softmax else x[..., 5:].sigmoid()
        return DensePredictions(
            boxes=torch.cat([center - half, center + half], -1).reshape(batch, -1, 4),
            objectness=x[..., 4].sigmoid().reshape(batch, -1),
            classes=classes.reshape(batch, -1, self.classes),
        )


def concatenate(parts: list[DensePredictions]) -> DensePredictions:
    """Predictions of several heads as one list."""
    return DensePredictions(
        torch.cat([p.boxes for p in parts], 1),
        torch.cat([p.objectness for p in parts], 1),
        torch.cat([p.classes for p in parts], 1),
    )
