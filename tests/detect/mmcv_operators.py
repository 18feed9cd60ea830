"""A stand-in for ``mmcv._ext``, mmcv's compiled operators: suppression, and what pools regions.

mmcv-lite holds all of mmcv but for this module, which takes a quarter of an hour to compile. As compiled for a CPU,
``roi_align`` takes its input for contiguous; here that is demanded.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from rauca_core.detect.frameworks.torchvision_ops import import_torchvision

import_torchvision()


def nms(boxes: Tensor, scores: Tensor, iou_threshold: float, offset: int) -> Tensor:
    """Indices that are kept, best first."""
    assert offset == 0
    return torch.ops.torchvision.nms(boxes, scores, iou_threshold)


def _align(features: Tensor, rois: Tensor, options: dict[str, Any]) -> Tensor:
    assert options["pool_mode"] == 1  # the mean
    assert features.is_contiguous()
    size = options["aligned_height"], options["aligned_width"]
    return torch.ops.torchvision.roi_align(
        features, rois, options["spatial_scale"], *size, options["sampling_ratio"], options["aligned"]
    )


def roi_align_forward(features: Tensor, rois: Tensor, out: Tensor, _y: Tensor, _x: Tensor, **options: Any) -> None:
    """Writes into ``out``."""
    out.copy_(_align(features, rois, options))


def roi_align_backward(slope: Tensor, rois: Tensor, _y: Tensor, _x: Tensor, out: Tensor, **options: Any) -> None:
    """Writes the gradient with respect to the features into ``out``; it does not depend on their values."""
    with torch.enable_grad():
        features = torch.zeros_like(out, requires_grad=True)
        out.copy_(torch.autograd.grad(_align(features, rois, options), features, slope)[0])


def __getattr__(name: str) -> Any:
    """mmcv asks whether it is all there when it is imported; the rest may not be called."""
    if name.startswith("__"):
        raise AttributeError(name)

    def absent(*_: Any, **__: Any) -> None:
        raise NotImplementedError(f"mmcv's operator {name} is not compiled")

    return absent
