"""What every detector offers, whatever its family."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor


@dataclass
class DensePredictions:
    """Predictions before non-maximum suppression, differentiable with respect to the image.

    Attributes:
        boxes: (B, N, 4) xyxy, pixels of the image that was passed in.
        objectness: (B, N) in [0, 1]; ones for detectors that have none.
        classes: (B, N, C) class probabilities in [0, 1], given an object.
    """

    boxes: Tensor
    objectness: Tensor
    classes: Tensor

    def to(self, dtype: torch.dtype) -> DensePredictions:
        """The same in another precision."""
        return DensePredictions(self.boxes.to(dtype), self.objectness.to(dtype), self.classes.to(dtype))


@dataclass
class Detections:
    """Final detections of one image, best first.

    Attributes:
        boxes: (M, 4) xyxy, pixels of the image that was passed in.
        scores: (M,) in [0, 1].
        labels: (M,) int64 indices into the detector's ``class_names``.
    """

    boxes: Tensor
    scores: Tensor
    labels: Tensor


class Detector(Protocol):
    """A detector. Letterboxing, channel order and input normalization are its own business.

    Attributes:
        name: as in tables, e.g. ``"yolov3-tiny"``.
        class_names: (C,) names, see :mod:`rauca_core.detect.classes`.
        fingerprint: hexadecimal; changes with anything that could change a prediction (weights, network, input size,
            class names), so that results may be kept on disk under it.
    """

    name: str
    class_names: tuple[str, ...]
    fingerprint: str

    def to(self, device: torch.device | str) -> Detector:
        """Move the network to a device; returns self."""
        ...

    def dense(self, images: Tensor) -> DensePredictions:
        """Predict from sRGB images (B, 3, H, W) in [0, 1]; gradients flow to ``images``.

        Raises:
            RaucaError: images of another shape, type or range, or with NaN; see :mod:`rauca_core.detect.checks`.
        """
        ...

    def detect(self, images: Tensor, score_threshold: float = 0.005, iou_threshold: float = 0.45) -> list[Detections]:
        """Final detections per image after class-wise non-maximum suppression; no gradient.

        Raises:
            RaucaError: as :meth:`dense`.
        """
        ...
