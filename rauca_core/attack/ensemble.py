"""The detectors that a camouflage is optimized against: one, or several at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from ..contract import RaucaError
from ..detect import Detector, class_index
from .das import attention_layer, watching
from .losses import OBJECTIVES, ObjectiveName, Predicted, detection_score


@dataclass(frozen=True, eq=False)
class Attacked:
    """What an ensemble made of a batch.

    Attributes:
        losses: (B,) the objective per image, mean over the detectors by weight.
        scores: (B,) max H_d per image, the highest over the detectors: what is left to hide.
        gradient: (B, 3, H, W) of the sum of ``losses`` with respect to the images.
    """

    losses: Tensor
    scores: Tensor
    gradient: Tensor


class DetectorEnsemble:
    """White-box detectors, each with a weight in the attack loss.

    Detectors are run and differentiated one after another: memory is that of the largest, not of all.
    """

    def __init__(
        self,
        detectors: Sequence[Detector],
        target: str,
        weights: Sequence[float] | None = None,
        precision: str = "float32",
        objective: ObjectiveName = "eq6",
    ) -> None:
        """Check the ensemble.

        Args:
            target: the class to hide; every detector must know it.
            weights: one per detector, of any sum; equal if left out.
            precision: of the detectors' networks, ``float32`` or ``bfloat16``; losses are in float32.
            objective: what is made small, see `losses`.

        Raises:
            RaucaError: no detectors, as many weights as there are not detectors, an unknown class, a detector that
                does not show what the objective needs.
        """
        if not detectors:
            raise RaucaError("optimize: no detector given; name at least one")
        weights = [1.0] * len(detectors) if weights is None else list(weights)
        if len(weights) != len(detectors):
            raise RaucaError(f"weights: {len(weights)} for {len(detectors)} detectors; give one to each, or none")
        if min(weights) < 0 or sum(weights) <= 0:
            raise RaucaError(f"weights: {weights} must be 0 or above, one of them above 0")
        self.detectors, self.precision = tuple(detectors), precision
        self.weights = tuple(weight / sum(weights) for weight in weights)
        self._labels = [class_index(detector, target) for detector in detectors]
        self._objective = OBJECTIVES[objective]
        self._watched = [attention_layer(d) if objective == "attention" else None for d in detectors]

    @property
    def name(self) -> str:
        """As in tables: the detectors' names, joined by plus signs."""
        return "+".join(detector.name for detector in self.detectors)

    @property
    def identity(self) -> list[Any]:
        """What of the ensemble a result depends on, as JSON."""
        return [[d.fingerprint, round(weight, 9)] for d, weight in zip(self.detectors, self.weights, strict=True)]

    @property
    def turns(self) -> int:
        """Detectors that have a weight."""
        return sum(weight > 0 for weight in self.weights)

    def attack(self, images: Tensor, boxes: Tensor, turn: int | None = None) -> Attacked:
        """The objective on sRGB images (B, 3, H, W) that show the target at ``boxes`` (B, 4) xyxy pixels.

        Args:
            turn: attack one detector alone, by turns; over a round the mean is that of all. None attacks all at once.
        """
        images = images.detach().requires_grad_()
        losses, scores = images.new_zeros(len(images)), images.new_zeros(len(images))
        parts = [p for p in zip(self.detectors, self.weights, self._labels, self._watched, strict=True) if p[1]]
        if turn is not None:
            detector, weight, label, layer = parts[turn % self.turns]
            parts = [(detector, weight * self.turns, label, layer)]
        for detector, weight, label, layer in parts:
            half = torch.autocast(images.device.type, torch.bfloat16, enabled=self.precision == "bfloat16")
            with half, watching(layer) as seen:
                found = detector.dense(images)
            # A network in bfloat16 may answer in it; there 1 - 1e-6 is 1, and a certain detection's loss infinite.
            found = found.to(images.dtype)
            found_score = detection_score(found, boxes, label)
            predicted = Predicted(found, boxes, label, found_score, seen[-1] if seen else None)
            loss = weight * self._objective(predicted)
            if loss.requires_grad:  # not where the detector returned no box at all
                loss.sum().backward()
            losses += loss.detach()
            scores = torch.maximum(scores, found_score.detach())
        gradient = images.grad if images.grad is not None else torch.zeros_like(images)
        return Attacked(losses, scores, gradient)
