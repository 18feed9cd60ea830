"""What detectors share whose final detections are their dense predictions, suppressed."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch
from torch import Tensor

from .checks import check_images
from .interface import DensePredictions, Detections
from .nms import clipped, detections


class SinglePassDetector(ABC):
    """Checks images, predicts once, suppresses; see :class:`rauca_core.detect.Detector`.

    Attributes:
        name: in messages and tables.
    """

    name: str

    @abstractmethod
    def _predict(self, images: Tensor) -> DensePredictions:
        """Predictions in checked sRGB images (B, 3, H, W), boxes in their pixels."""

    def dense(self, images: Tensor) -> DensePredictions:
        """Predict from sRGB images (B, 3, H, W) in [0, 1]; gradients flow to ``images``."""
        check_images(self.name, images)
        return self._predict(images)

    @torch.inference_mode()
    def detect(self, images: Tensor, score_threshold: float = 0.005, iou_threshold: float = 0.45) -> list[Detections]:
        """Final detections per image, boxes clipped to it; see :class:`rauca_core.detect.Detector`."""
        check_images(self.name, images, waits=True)
        return clipped(detections(self._predict(images), score_threshold, iou_threshold), images)
