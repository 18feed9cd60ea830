"""Dense predictions of torchvision's detection models: its own modules, called up to where post-processing begins.

Each function takes the model, the transformed images and their features, and returns predictions in the pixels of the
transformed images, clipped to them as torchvision does. Column 0 of the classes is still the background's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional
from torch.nn.utils.rnn import pad_sequence

from ..interface import DensePredictions

Head = Callable[[Any, Any, Mapping[str, Tensor]], DensePredictions]


def two_stage(model: Any, images: Any, features: Mapping[str, Tensor]) -> DensePredictions:
    """Every proposal after the box head, with the box that belongs to its most probable category.

    Proposals carry no gradient, as in the framework: features do, through the region pooling. Images with fewer
    proposals than others are filled up with empty boxes of objectness 0.
    """
    proposals, _ = model.rpn(images, features)
    heads = model.roi_heads
    pooled = heads.box_head(heads.box_roi_pool(features, proposals, images.image_sizes))
    logits, offsets = heads.box_predictor(pooled)
    boxes = heads.box_coder.decode(offsets, proposals).reshape(-1, logits.shape[1], 4)
    classes = logits.softmax(-1)
    best = 1 + classes[:, 1:].argmax(1)
    boxes = _clip(boxes[torch.arange(len(best), device=best.device), best], images)
    counts = [len(one) for one in proposals]
    padded = [pad_sequence(one.split(counts), batch_first=True) for one in (boxes, classes)]
    objectness = pad_sequence([boxes.new_ones(count) for count in counts], batch_first=True)
    return DensePredictions(padded[0], objectness, padded[1])


def retinanet(model: Any, images: Any, features: Mapping[str, Tensor]) -> DensePredictions:
    """Every anchor; categories are independent of one another (sigmoid)."""
    found, boxes = _anchored(model, images, features)
    return DensePredictions(boxes, torch.ones_like(boxes[..., 0]), found["cls_logits"].sigmoid())


def fcos(model: Any, images: Any, features: Mapping[str, Tensor]) -> DensePredictions:
    """Every point; torchvision's score, sqrt(P(class) * centerness), is the product of ``objectness`` and ``classes``.

    The root is taken in the exponent, where its slope stays finite when a probability rounds to 0.
    """
    found, boxes = _anchored(model, images, features)
    centerness, classes = ((functional.logsigmoid(found[key]) / 2).exp() for key in ("bbox_ctrness", "cls_logits"))
    return DensePredictions(boxes, centerness[..., 0], classes)


def ssd(model: Any, images: Any, features: Mapping[str, Tensor]) -> DensePredictions:
    """Every default box; categories exclude one another (softmax)."""
    found, boxes = _anchored(model, images, features)
    return DensePredictions(boxes, torch.ones_like(boxes[..., 0]), found["cls_logits"].softmax(-1))


def _anchored(model: Any, images: Any, features: Mapping[str, Tensor]) -> tuple[dict[str, Tensor], Tensor]:
    """The head's outputs (B, N, ...) and decoded boxes (B, N, 4) of a model without a second stage."""
    levels = list(features.values())
    found: dict[str, Tensor] = model.head(levels)
    anchors = model.anchor_generator(images, levels)
    decode = getattr(model.box_coder, "decode_single", model.box_coder.decode)
    boxes = torch.stack([decode(*one) for one in zip(found["bbox_regression"], anchors, strict=True)])
    return found, _clip(boxes, images)


def _clip(boxes: Tensor, images: Any) -> Tensor:
    """Images of a batch are of one size."""
    height, width = images.image_sizes[0]
    return boxes.clamp(min=0).minimum(boxes.new_tensor([width, height, width, height]))
