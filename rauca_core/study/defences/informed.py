"""A detector behind a defence, for an attack that knows of it."""

from __future__ import annotations

import torch
from torch import Tensor

from ...detect import DensePredictions, Detections, Detector
from ..artifact import digest_of
from .interface import Defence


class DefendedDetector:
    """A detector that sees images after a defence, as an attacker who knows of both would model them.

    Most defences have no useful gradient. On the way back they are taken for the identity (backward pass differentiable
    approximation, BPDA; Athalye, Carlini and Wagner, ICML 2018): the detector's own gradient, at the defended image.
    """

    def __init__(self, detector: Detector, defence: Defence) -> None:
        self._detector, self._defence = detector, defence
        self.name = f"{detector.name}+{defence.name}"
        self.class_names = detector.class_names
        self.fingerprint = digest_of([detector.fingerprint, defence.fingerprint])

    def to(self, device: torch.device | str) -> DefendedDetector:
        """Move the network to a device; returns self."""
        self._detector.to(device)
        return self

    def dense(self, images: Tensor) -> DensePredictions:
        """As of the detector, at the defended images (B, 3, H, W), sRGB in [0, 1]."""
        with torch.no_grad():
            change = self._defence(images.detach().float().clamp(0, 1)).to(images) - images
        return self._detector.dense(images + change)

    def detect(self, images: Tensor, score_threshold: float = 0.005, iou_threshold: float = 0.45) -> list[Detections]:
        """As of the detector, in the defended images."""
        return self._detector.detect(self._defence(images), score_threshold, iou_threshold)
