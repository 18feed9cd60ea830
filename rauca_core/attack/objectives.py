"""What methods make small on a detector: one loss per image, by name.

All are finite, with finite gradients, on no boxes at all, on boxes that miss the vehicle and at a confidence of 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from ..detect.interface import DensePredictions
from .attention import dispersed_attention
from .losses import attack_loss, box_overlap

ObjectiveName = Literal["eq6", "log-score", "stealth", "confidence", "three-terms", "attention"]

QUIET = 1e-3  # a max H_d below this is not worth pushing: average precision counts scores from 0.005 on
CLOSE = 0.5  # IoU beyond which ACTIVE counts a box
ASSIGNED = 9  # boxes that FCA's three terms are means of: as many as YOLOv3 has anchors for an object
OVERLAP_WEIGHT, OBJECTNESS_WEIGHT, CLASS_WEIGHT = 0.05, 1.0, 0.5  # of FCA, those of the detector's own training


@dataclass(frozen=True, eq=False)
class Sight:
    """What one detector makes of a batch.

    Attributes:
        predictions: before non-maximum suppression.
        truth: (B, 4) xyxy, where the vehicle is.
        label: index of the vehicle's class.
        score: (B,) max H_d, see ``losses.detection_score``.
        features: (B, C, h, w) what the detector's attention is read from; only where the objective asks for it.
    """

    predictions: DensePredictions
    truth: Tensor
    label: int
    score: Tensor
    features: Tensor | None = None


def eq6(sight: Sight) -> Tensor:
    """RAUCA's Eq. 6: IoU times class times objectness, the best box."""
    return attack_loss(sight.score)


def log_score(sight: Sight) -> Tensor:
    """log(1 + max H_d / QUIET), so that a small score pushes as hard as a large one.

    Eq. 6 has the slope of H_d itself, which dies with the detector's sigmoid: on frames where H_d is 0.05 it has let
    go, and average precision still counts them.
    """
    return torch.log1p(sight.score / QUIET)


def stealth(sight: Sight) -> Tensor:
    """ACTIVE's Eq. 4: the likeliest class, whichever, times objectness; the best of the boxes near the vehicle."""
    found = sight.predictions
    if found.classes.shape[1] == 0:
        return torch.zeros_like(sight.score)
    near = box_overlap(found.boxes.detach(), sight.truth) > CLOSE
    return attack_loss(_highest(found.classes.amax(-1) * found.objectness, near))


def confidence(sight: Sight) -> Tensor:
    """DTA's loss: the vehicle's class times objectness, the best of the boxes that touch the vehicle."""
    found = sight.predictions
    touching = box_overlap(found.boxes.detach(), sight.truth) > 0
    return attack_loss(_highest(found.classes[..., sight.label] * found.objectness, touching))


def three_terms(sight: Sight) -> Tensor:
    """FCA's detection loss: overlap, objectness and class of the boxes assigned to the vehicle, a weighted sum.

    Assigned are those that overlap it most.
    """
    found = sight.predictions
    overlap = box_overlap(found.boxes, sight.truth)
    number = min(ASSIGNED, overlap.shape[1])
    if number == 0:
        return torch.zeros_like(sight.score)
    best = overlap.detach().topk(number, 1).indices
    terms = torch.stack([t.gather(1, best) for t in (overlap, found.objectness, found.classes[..., sight.label])])
    assigned = (terms[0].detach() > 0).to(terms)
    means = (terms * assigned).sum(2) / assigned.sum(1).clamp(min=1)
    weights = means.new_tensor([OVERLAP_WEIGHT, OBJECTNESS_WEIGHT, CLASS_WEIGHT])
    return weights @ means


def attention(sight: Sight) -> Tensor:
    """DAS's model attention, see `attention`."""
    if sight.features is None:
        raise ValueError("attention: the detector's features were not watched")
    return dispersed_attention(sight.score, sight.features)


def _highest(scores: Tensor, among: Tensor) -> Tensor:
    """(B, N), (B, N) bool -> (B,); 0 where there is none."""
    if scores.shape[1] == 0:
        return scores.new_zeros(len(scores))
    return torch.where(among, scores, 0.0).amax(1)


OBJECTIVES: dict[ObjectiveName, Callable[[Sight], Tensor]] = {
    "eq6": eq6,
    "log-score": log_score,
    "stealth": stealth,
    "confidence": confidence,
    "three-terms": three_terms,
    "attention": attention,
}
