"""Stretching an image to the square that an SSD takes, without antialiasing, as these networks were trained and run."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional


def stretch(images: Tensor, size: int, half_pixel_centers: bool) -> Tensor:
    """(B, 3, H, W) -> (B, 3, size, size), bilinear; untouched when it already fits. Differentiable.

    Args:
        half_pixel_centers: True samples at (i + 0.5) * scale - 0.5, as OpenCV and TensorFlow 2 do; False at i * scale,
            as ``ResizeBilinear`` in graphs of TensorFlow 1, which moves the picture by (scale - 1) / 2 of its pixels.
    """
    if images.shape[2:] == (size, size):
        return images
    if half_pixel_centers:
        return functional.interpolate(images, size=(size, size), mode="bilinear", align_corners=False)
    return _lerp(_lerp(images, 2, size), 3, size)


def _lerp(images: Tensor, axis: int, size: int) -> Tensor:
    extent = images.shape[axis]
    # float64: i * scale that should be a whole number must not fall on the pixel before it
    position = torch.arange(size, dtype=torch.float64, device=images.device) * (extent / size)
    low = position.floor().long().clamp(max=extent - 1)
    weight = (position - low).to(images.dtype).reshape([-1 if a == axis else 1 for a in range(4)])
    before = images.index_select(axis, low)
    return torch.lerp(before, images.index_select(axis, (low + 1).clamp(max=extent - 1)), weight)
