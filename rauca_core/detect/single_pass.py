"""What detectors share whose final detections are their dense predictions, suppressed."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch
from torch import Tensor, nn

from .checks import check_images, in_type_of
from .interface import DensePredictions, Detections
from .nms import clipped, detections


class SinglePassDetector(ABC):
    """Checks images, predicts once, suppresses; see :class:`rauca_core.detect.Detector`.

    Attributes:
        name: in messages and tables.
        network: what torch computes with; None where another runtime does.
    """

    name: str
    network: nn.Module | None

    @abstractmethod
    def _predict(self, images: Tensor) -> DensePredictions:
        """Predictions in checked sRGB images (B, 3, H, W) of the network's type, boxes in their pixels."""

    def dense(self, images: Tensor) -> DensePredictions:
        """Predict from sRGB images (B, 3, H, W) in [0, 1]; gradients flow to ``images``."""
        return self._predict(self._checked(images))

    @torch.inference_mode()
    def detect(self, images: Tensor, score_threshold: float = 0.005, iou_threshold: float = 0.45) -> list[Detections]:
        """Final detections per image, boxes clipped to it; see :class:`rauca_core.detect.Detector`."""
        images = self._checked(images, waits=True)
        return clipped(detections(self._predict(images), score_threshold, iou_threshold), images)

    def _checked(self, images: Tensor, waits: bool = False) -> Tensor:
        check_images(self.name, images, waits)
        return in_type_of(self.network, images)
