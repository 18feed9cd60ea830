"""A detector behind a defence, for an attack that knows of it."""

from __future__ import annotations

import torch
from torch import Tensor

from ...detect import DensePredictions, Detections, Detector
from ..artifact import digest_of
from .interface import Defence

STAND_INS = 1  # raised whenever one of them changes


class DefendedDetector:
    """A detector that sees images after a defence, as an attacker who knows of both would model them.

    Most defences have no useful gradient of their own. The detector sees the defence itself; on the way back its
    ``stand_in`` is differentiated (backward pass differentiable approximation, BPDA; Athalye, Carlini and Wagner, ICML
    2018). No defence here draws anything, so that there is no expectation to take beyond the attack's own.
    """

    def __init__(self, detector: Detector, defence: Defence) -> None:
        self._detector, self._defence = detector, defence
        self.name = f"{detector.name}+{defence.name}"
        self.class_names = detector.class_names
        self.fingerprint = digest_of([detector.fingerprint, defence.fingerprint, STAND_INS])

    def to(self, device: torch.device | str) -> DefendedDetector:
        """Move the network to a device; returns self."""
        self._detector.to(device)
        return self

    def dense(self, images: Tensor) -> DensePredictions:
        """As of the detector, at the defended images (B, 3, H, W), sRGB in [0, 1]."""
        through = self._defence.stand_in(images)
        with torch.no_grad():
            change = self._defence(images.detach().float().clamp(0, 1)).to(images) - through
        return self._detector.dense(through + change)

    def detect(self, images: Tensor, score_threshold: float = 0.005, iou_threshold: float = 0.45) -> list[Detections]:
        """As of the detector, in the defended images."""
        return self._detector.detect(self._defence(images), score_threshold, iou_threshold)
