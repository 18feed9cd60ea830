"""Final detections from dense ones: box overlap, non-maximum suppression, networks that need none, and the detectors
whose final detections are their dense ones, suppressed.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
import torch
from torch import Tensor

from ..runtime.kernels import njit
from .interface import OVERLAP, DensePredictions, Detections, check_images, in_type_of

# Per class. Greedy suppression never looks back: what it keeps among the best 4096 is what a full run keeps there.
MAX_CANDIDATES = 4096
SMALLEST_UNION = 1e-12  # square pixels: empty boxes overlap nothing


def box_iou(a: Tensor, b: Tensor) -> Tensor:
    """Intersection over union of (..., N, 4) and (..., M, 4) xyxy boxes: (..., N, M); empty boxes overlap nothing."""
    shared, union = _shared(a, b), _area(a)[..., :, None] + _area(b)[..., None, :]
    return shared / (union - shared).clamp(min=SMALLEST_UNION)


def share_within(a: Tensor, b: Tensor) -> Tensor:
    """Share of each of (..., N, 4) xyxy boxes that lies in each of (..., M, 4): (..., N, M); 0 of empty boxes."""
    return _shared(a, b) / _area(a)[..., :, None].clamp(min=SMALLEST_UNION)


def _shared(a: Tensor, b: Tensor) -> Tensor:
    """Area that each of (..., N, 4) xyxy boxes shares with each of (..., M, 4): (..., N, M)."""
    top_left = torch.maximum(a[..., :, None, :2], b[..., None, :, :2])
    bottom_right = torch.minimum(a[..., :, None, 2:], b[..., None, :, 2:])
    return (bottom_right - top_left).clamp(min=0).prod(-1)


def _area(boxes: Tensor) -> Tensor:
    """(..., 4) xyxy -> (...); 0 of empty boxes."""
    return (boxes[..., 2:] - boxes[..., :2]).clamp(min=0).prod(-1)


def generalized_iou(a: Tensor, b: Tensor) -> Tensor:
    """Of xyxy boxes (..., 4) that broadcast against each other: (...) in [-1, 1] (Rezatofighi et al., 2019)."""
    shared = torch.minimum(a[..., 2:], b[..., 2:]) - torch.maximum(a[..., :2], b[..., :2])
    shared_area = shared.clamp(min=0).prod(-1)
    union = (_area(a) + _area(b) - shared_area).clamp(min=1e-9)
    hull = torch.maximum(a[..., 2:], b[..., 2:]) - torch.minimum(a[..., :2], b[..., :2])
    hull_area = hull.clamp(min=0).prod(-1).clamp(min=1e-9)
    return shared_area / union - (hull_area - union) / hull_area


def corners(boxes: Tensor) -> Tensor:
    """(..., 4) center and size -> xyxy."""
    center, half = boxes[..., :2], boxes[..., 2:] / 2
    return torch.cat([center - half, center + half], -1)


def centered(boxes: Tensor) -> Tensor:
    """(..., 4) xyxy -> center and size."""
    return torch.cat([(boxes[..., :2] + boxes[..., 2:]) / 2, boxes[..., 2:] - boxes[..., :2]], -1)


def suppress(boxes: Tensor, iou_threshold: float, labels: Tensor | None = None) -> Tensor:
    """Greedy non-maximum suppression of (N, 4) boxes sorted best first: (N,) bool, True for those kept.

    A box is kept when no kept box before it, of its own label, overlaps it by more than ``iou_threshold``.

    Args:
        labels: (N,) integers, each label's boxes together; all are of one if left out.
    """
    exact = boxes if boxes.dtype in (torch.float32, torch.float64) else boxes.float()
    array = np.ascontiguousarray(exact.detach().cpu().numpy())
    groups = np.zeros(len(array), np.int64) if labels is None else labels.cpu().numpy()
    kept, kind = np.zeros(len(array), np.bool_), array.dtype.type  # constants of another type would change roundings
    _suppress(array, groups, kind(iou_threshold), kind(0), kind(SMALLEST_UNION), kept)
    return torch.from_numpy(kept).to(boxes.device)


@njit(cache=True, nogil=True)
def _suppress(boxes: Any, labels: Any, threshold: Any, zero: Any, smallest: Any, kept: Any) -> None:
    """The overlaps are those of :func:`box_iou`, NaN and endless boxes included."""
    areas = np.maximum(boxes[:, 2] - boxes[:, 0], zero) * np.maximum(boxes[:, 3] - boxes[:, 1], zero)
    before = np.empty(len(boxes), np.int64)  # the kept ones of the label at hand
    count = 0
    for i in range(len(boxes)):
        if i > 0 and labels[i] != labels[i - 1]:
            count = 0
        free = True
        for k in before[:count]:
            width = np.minimum(boxes[i, 2], boxes[k, 2]) - np.maximum(boxes[i, 0], boxes[k, 0])
            height = np.minimum(boxes[i, 3], boxes[k, 3]) - np.maximum(boxes[i, 1], boxes[k, 1])
            shared = np.maximum(width, zero) * np.maximum(height, zero)
            if shared / np.maximum(areas[i] + areas[k] - shared, smallest) > threshold:
                free = False
                break
        if free:
            kept[i] = True
            before[count] = i
            count += 1


def detections(predictions: DensePredictions, score_threshold: float, iou_threshold: float) -> list[Detections]:
    """Final detections per image, best first; a box may speak for several classes, each suppressed on its own.

    The score is objectness times class probability; only scores above ``score_threshold`` count.
    """
    scores = predictions.objectness[..., None] * predictions.classes
    return [
        _of_one_image(boxes, image_scores, score_threshold, iou_threshold)
        for boxes, image_scores in zip(predictions.boxes, scores, strict=True)
    ]


def _of_one_image(boxes: Tensor, scores: Tensor, score_threshold: float, iou_threshold: float) -> Detections:
    index, label = (scores > score_threshold).nonzero(as_tuple=True)
    order = scores[index, label].argsort(descending=True, stable=True)
    order = order[label[order].argsort(stable=True)]
    index, label = index[order], label[order]
    place = torch.arange(len(label), device=label.device) - torch.searchsorted(label, label)
    index, label = index[place < MAX_CANDIDATES], label[place < MAX_CANDIDATES]
    kept = suppress(boxes[index], iou_threshold, label)
    index, label = index[kept], label[kept]
    order = scores[index, label].argsort(descending=True, stable=True)
    index, label = index[order], label[order]
    return Detections(boxes[index], scores[index, label], label)


def of_queries(found: DensePredictions, score_threshold: float, exclusive: bool, limit: int = 0) -> list[Detections]:
    """Final detections per image of networks that say each object once, best first; none is suppressed.

    A score is objectness times class probability.

    Args:
        exclusive: a query speaks for its best class alone; otherwise for every class, and the best pairs of an image
            count.
        limit: most of these pairs; 0 for one per query.
    """
    scores = found.objectness[..., None] * found.classes
    if exclusive:
        best, labels = scores.max(-1)
        best, queries = best.sort(dim=1, descending=True, stable=True)
        labels = labels.gather(1, queries)
    else:
        best, pairs = scores.flatten(1).topk(min(limit or scores.shape[1], scores[0].numel()), 1)
        queries, labels = pairs // scores.shape[2], pairs % scores.shape[2]
    kept = best > score_threshold
    return [
        Detections(boxes[query[keep]], score[keep], label[keep])
        for boxes, query, score, label, keep in zip(found.boxes, queries, best, labels, kept, strict=True)
    ]


def clipped(found: Sequence[Detections], images: Tensor) -> list[Detections]:
    """Detections with their boxes clipped to the images (B, 3, H, W) that they were found in."""
    limit = images.new_tensor([images.shape[3], images.shape[2]] * 2)
    return [Detections(one.boxes.clamp(min=0).minimum(limit), one.scores, one.labels) for one in found]


class SinglePassDetector(ABC):
    """Checks images, predicts once, suppresses; what an adapter does in another way it overrides.

    Attributes:
        name, class_names, fingerprint: see :class:`rauca_core.detect.Detector`.
        network: the differentiable module, in evaluation mode; its weights take no gradient. None where another runtime
            computes.
    """

    name: str
    class_names: tuple[str, ...]
    fingerprint: str
    network: Any

    def to(self, device: torch.device | str) -> Self:
        """Move the network to a device; returns self."""
        if self.network is not None:
            self.network.to(device)
        return self

    @abstractmethod
    def _predict(self, images: Tensor) -> DensePredictions:
        """Predictions in checked sRGB images (B, 3, H, W) of the network's type, boxes in their pixels."""

    def dense(self, images: Tensor) -> DensePredictions:
        """Predict from sRGB images (B, 3, H, W) in [0, 1]; gradients flow to ``images``."""
        return self._predict(self._checked(images))

    @torch.no_grad()  # not inference_mode: a network may keep tables for the next call, dense's perhaps
    def detect(
        self, images: Tensor, score_threshold: float = 0.005, iou_threshold: float = OVERLAP
    ) -> list[Detections]:
        """Final detections per image, boxes clipped to it; see :class:`rauca_core.detect.Detector`."""
        images = self._checked(images, waits=True)
        return clipped(self._final(images, score_threshold, iou_threshold), images)

    def _final(self, images: Tensor, score_threshold: float, iou_threshold: float) -> list[Detections]:
        """Final detections in checked images."""
        return detections(self._predict(images), score_threshold, iou_threshold)

    def _checked(self, images: Tensor, waits: bool = False) -> Tensor:
        check_images(self.name, images, waits)
        return in_type_of(self.network, images)
