"""A detector of our own behind the interface of all."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ..checks import check_images, in_type_of
from ..interface import DensePredictions, Detections
from ..letterbox import Letterbox
from ..nms import clipped, detections
from .networks import trainable


class SynthDetector:
    """A trained network behind :class:`rauca_core.detect.Detector`.

    Objectness is one everywhere: the class probabilities already say whether anything is there.

    Attributes:
        name, class_names, fingerprint: see :class:`rauca_core.detect.Detector`.
        size: the network's square input, pixels.
        network: the differentiable module; its weights take no gradient.
    """

    def __init__(
        self, name: str, network: nn.Module, class_names: tuple[str, ...], size: int, fingerprint: str = ""
    ) -> None:
        self.name, self.class_names, self.size, self.fingerprint = name, class_names, size, fingerprint
        self.network = network

    def to(self, device: torch.device | str) -> SynthDetector:
        """Move the network to a device; returns self."""
        self.network.to(device)
        return self

    def dense(self, images: Tensor) -> DensePredictions:
        """Predict from sRGB images (B, 3, H, W) in [0, 1]; gradients flow to ``images``."""
        check_images(self.name, images)
        box = Letterbox(images.shape[2], images.shape[3], self.size)
        found = trainable(self.network).dense(box.fit(in_type_of(self.network, images)))
        found.boxes = box.boxes_to_image(found.boxes)
        return found

    @torch.no_grad()
    def detect(self, images: Tensor, score_threshold: float = 0.005, iou_threshold: float = 0.45) -> list[Detections]:
        """Final detections per image, boxes clipped to it; see :class:`rauca_core.detect.Detector`."""
        check_images(self.name, images, waits=images.device.type != "cpu")
        found = detections(self.dense(images), score_threshold, iou_threshold)
        return clipped(found, in_type_of(self.network, images))
