"""torchvision where its compiled operators do not load.

The package index ships torchvision's operators compiled for CUDA; beside a CPU build of torch they do not load, and
``import torchvision`` fails. Its detection models need just two of them, which are given to torch's operator registry
here. Where the compiled operators load, nothing is changed.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType

import torch
from torch import Tensor
from torch.nn import functional

from ..foreign import extra
from ..nms import suppress

# What torchvision cannot be imported without; qnms (quantized boxes) is only ever declared.
_DECLARED = {
    "nms": "nms(Tensor dets, Tensor scores, float iou_threshold) -> Tensor",
    "qnms": "qnms(Tensor dets, Tensor scores, float iou_threshold) -> Tensor",
    "roi_align": "roi_align(Tensor input, Tensor rois, float spatial_scale, SymInt pooled_height, SymInt pooled_width, "
    "int sampling_ratio, bool aligned) -> Tensor",
}
_libraries: list[torch.library.Library] = []  # an operator lives as long as its library


def import_torchvision() -> ModuleType:
    """The torchvision package, able to run its detection models.

    Call it before anything that imports torchvision itself (``onnx2torch``, ``transformers``).

    Raises:
        RaucaError: torchvision is not installed.
    """
    if "torchvision" not in sys.modules:
        _import_or_supply()
    torchvision = importlib.import_module("torchvision")
    if not torchvision.extension._has_ops():
        _supply()
        boxes, align = (importlib.import_module(f"torchvision.ops.{name}") for name in ("boxes", "roi_align"))
        boxes._assert_has_ops = align._assert_has_ops = lambda: None  # type: ignore[attr-defined]
        align._has_ops = lambda: True  # type: ignore[attr-defined]
    return torchvision


def _import_or_supply() -> None:
    try:
        extra("torchvision")
    except RuntimeError as error:
        if "torchvision::" not in str(error):
            raise
        for name in [name for name in sys.modules if name.partition(".")[0] == "torchvision"]:
            del sys.modules[name]  # modules of the import that broke off
        _supply()


def _supply() -> None:
    """Register what is not registered yet."""
    missing = [name for name in _DECLARED if not hasattr(torch.ops.torchvision, name)]
    if not missing:
        return
    library = torch.library.Library("torchvision", "FRAGMENT")
    _libraries.append(library)
    for name in missing:
        library.define(_DECLARED[name])
    if "nms" in missing:
        library.impl("nms", nms, "CompositeExplicitAutograd")
    if "roi_align" in missing:
        library.impl("roi_align", roi_align, "CompositeImplicitAutograd")


def nms(boxes: Tensor, scores: Tensor, iou_threshold: float) -> Tensor:
    """Indices of the boxes that greedy non-maximum suppression keeps, best first.

    Args:
        boxes: (N, 4) xyxy.
        scores: (N,).
        iou_threshold: a box goes when it overlaps a better one that stays by more than this.
    """
    order = scores.argsort(descending=True, stable=True)
    return order[suppress(boxes[order], iou_threshold)]


def roi_align(
    features: Tensor,
    rois: Tensor,
    spatial_scale: float,
    pooled_height: int,
    pooled_width: int,
    sampling_ratio: int,
    aligned: bool,
) -> Tensor:
    """Mean of bilinear samples in each bin of each region, differentiable with respect to ``features``.

    Every output is a weighted sum of feature rows, which is what ``embedding_bag`` computes: no sample is ever stored.

    Args:
        features: (N, C, H, W).
        rois: (K, 5) image index and xyxy, in units of ``1 / spatial_scale`` feature cells; takes no gradient, as in
            torchvision.
        sampling_ratio: samples per bin and axis; 0 or less for one per feature cell, at most.
        aligned: whether feature (0, 0) has its center at +0.5, rather than at 0.

    Returns:
        (K, C, pooled_height, pooled_width).
    """
    images, channels, height, width = features.shape
    rois = rois.detach()
    corners = rois[:, 1:] * spatial_scale - (0.5 if aligned else 0.0)
    extent = corners[:, 2:] - corners[:, :2]
    if not aligned:
        extent = extent.clamp(min=1.0)
    x, x_weight = _axis_taps(corners[:, 0], extent[:, 0], pooled_width, width, sampling_ratio)
    y, y_weight = _axis_taps(corners[:, 1], extent[:, 1], pooled_height, height, sampling_ratio)
    row = rois[:, 0].long()[:, None, None] * height + y
    index = row[:, :, None, :, None] * width + x[:, None, :, None, :]
    weight = y_weight[:, :, None, :, None] * x_weight[:, None, :, None, :]
    table = features.permute(0, 2, 3, 1).reshape(images * height * width, channels)
    bags = (len(rois) * pooled_height * pooled_width, x.shape[2] * y.shape[2])
    pooled = functional.embedding_bag(
        index.reshape(bags), table, per_sample_weights=weight.reshape(bags).to(table.dtype), mode="sum"
    )
    return pooled.view(len(rois), pooled_height, pooled_width, channels).permute(0, 3, 1, 2).contiguous()


def _axis_taps(start: Tensor, extent: Tensor, bins: int, size: int, sampling_ratio: int) -> tuple[Tensor, Tensor]:
    """Along one axis: the cells that each bin of each region reads and their weights, both (K, bins, taps).

    Samples more than a cell outside the map count as zero, those less as its border.
    """
    if sampling_ratio > 0:
        count, most = torch.full_like(extent, sampling_ratio), sampling_ratio
    else:
        count = (extent / bins).ceil()
        most = max(1, int(count.max())) if len(count) else 1
    count = count[:, None, None]
    sample = torch.arange(most, device=start.device)
    within_bin = (sample + 0.5) / count.clamp(min=1)
    step = torch.arange(bins, device=start.device)[:, None] + within_bin
    position = start[:, None, None] + step * (extent[:, None, None] / bins)
    used = (position >= -1) & (position <= size) & (sample < count)
    position = position.clamp(0, size - 1)
    low = position.floor()
    fraction = position - low
    weight = torch.stack([1 - fraction, fraction], -1) * (used / count.clamp(min=1))[..., None]
    cell = torch.stack([low, (low + 1).clamp(max=size - 1)], -1)
    return cell.long().flatten(2), weight.flatten(2)
