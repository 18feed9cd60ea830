"""What methods make small on a detector: one loss per image, by name.

All are finite, with finite gradients, on no boxes at all, on boxes that miss the vehicle and at a confidence of 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from ..detect.interface import DensePredictions
from .das import dispersed_attention

# Eq. 6 has no finite value at a detection score of 1, which a detector's sigmoid does reach in float32. Scores count as
# this little less: the loss ends at 13.8 and keeps a non-zero slope, and values below 0.99 change by under 1e-4.
SCORE_SHRINK = 1e-6
TINY = 1e-6  # pixels, against a box without sides
FURTHEST = 1e6  # pixels from the picture that a box's edge counts as: the square of twice that is still finite


def box_overlap(boxes: Tensor, truth: Tensor) -> Tensor:
    """Intersection over union of boxes (B, N, 4) with one box per image (B, 4), xyxy -> (B, N) in [0, 1].

    Boxes without area, or turned inside out, overlap nothing; nor do those without end, where a network's exponential
    overflowed: their gradient is 0, not NaN.
    """
    boxes, truth = boxes.clamp(-FURTHEST, FURTHEST), truth[:, None]
    corner = torch.minimum(boxes[..., 2:], truth[..., 2:]) - torch.maximum(boxes[..., :2], truth[..., :2])
    shared = corner.clamp(min=0).prod(-1)
    area = (boxes[..., 2:] - boxes[..., :2]).clamp(min=0).prod(-1)
    union = area + (truth[..., 2:] - truth[..., :2]).clamp(min=0).prod(-1) - shared
    return shared / union.clamp(min=1e-6)


def complete_overlap(boxes: Tensor, truth: Tensor) -> Tensor:
    """Complete IoU of boxes (B, N, 4) with one box per image (B, 4), xyxy -> (B, N) in [-2, 1].

    IoU less the squared distance of the centers, of the diagonal of the box around both, less what the aspects differ
    (Zheng et al., Distance-IoU Loss, 2020), whose weight is a constant of the gradient, as in the public code.
    """
    iou = box_overlap(boxes, truth)
    boxes, truth = boxes.clamp(-FURTHEST, FURTHEST), truth[:, None]
    around = torch.maximum(boxes[..., 2:], truth[..., 2:]) - torch.minimum(boxes[..., :2], truth[..., :2])
    apart = (boxes[..., :2] + boxes[..., 2:] - truth[..., :2] - truth[..., 2:]) / 2
    sides, true_sides = ((b[..., 2:] - b[..., :2]).clamp(min=0) + TINY for b in (boxes, truth))
    angles = torch.atan2(true_sides[..., 0], true_sides[..., 1]) - torch.atan2(sides[..., 0], sides[..., 1])
    aspect = 4 / math.pi**2 * angles.square()
    weight = (aspect / (aspect - iou + 1 + TINY)).detach()
    return iou - apart.square().sum(-1) / (around.square().sum(-1) + TINY) - weight * aspect


def detection_score(predictions: DensePredictions, truth: Tensor, label: int) -> Tensor:
    """max H_d of Eq. 6 per image, (B,): IoU with the truth x class probability x objectness, the best over all boxes.

    Args:
        predictions: before non-maximum suppression.
        truth: (B, 4) xyxy in the image's pixels.
        label: index of the vehicle's class.
    """
    scores = box_overlap(predictions.boxes, truth) * predictions.classes[..., label] * predictions.objectness
    if scores.shape[1] == 0:
        return truth.new_zeros(len(truth))
    return scores.max(dim=1).values


def attack_loss(score: Tensor) -> Tensor:
    """Eq. 6, ``-log(1 - x)`` of values in [0, 1], elementwise; finite with a non-zero slope up to and at 1."""
    return -torch.log1p(-score * (1.0 - SCORE_SHRINK))


ObjectiveName = Literal["eq6", "complete", "log-score", "stealth", "confidence", "every-cell", "attention"]

QUIET = 1e-3  # a max H_d below this is not worth pushing: average precision counts scores from 0.005 on
CLOSE = 0.5  # IoU beyond which ACTIVE counts a box
ASSIGNED = 9  # boxes that FCA's terms are means of: as many as YOLOv3 has anchors for an object
OVERLAP_WEIGHT, OBJECTNESS_WEIGHT, CLASS_WEIGHT = 0.05, 1.0, 0.5  # of FCA, those of the detector's own training

# FCA's public code adds up the means of YOLOv3's three layers, those of objectness 4, 1 and 0.4 times; here one mean is
# over all of them.
LAYERS, BALANCE = 3.0, 5.4


@dataclass(frozen=True, eq=False)
class Predicted:
    """What one detector predicts of a batch.

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


def log_score(given: Predicted) -> Tensor:
    """log(1 + max H_d / QUIET), so that a small score pushes as hard as a large one.

    Eq. 6 has the slope of H_d itself, which dies with the detector's sigmoid: on frames where H_d is 0.05 it has let
    go, and average precision still counts them.
    """
    return torch.log1p(given.score / QUIET)


def complete(given: Predicted) -> Tensor:
    """Eq. 6 as the public code of RAUCA has it: complete IoU for IoU, which is negative for boxes elsewhere."""
    found = given.predictions
    if found.classes.shape[1] == 0:
        return torch.zeros_like(given.score)
    scores = complete_overlap(found.boxes, given.truth) * (found.classes[..., given.label] * found.objectness)
    return attack_loss(scores.amax(1))


def stealth(given: Predicted) -> Tensor:
    """ACTIVE's Eq. 4: the likeliest class, whichever, times objectness; the best of the boxes near the vehicle."""
    found = given.predictions
    if found.classes.shape[1] == 0:
        return torch.zeros_like(given.score)
    near = box_overlap(found.boxes.detach(), given.truth) > CLOSE
    return attack_loss(_highest(found.classes.amax(-1) * found.objectness, near))


def confidence(given: Predicted) -> Tensor:
    """DTA's loss: the vehicle's class times objectness, the best of the boxes that touch the vehicle."""
    found = given.predictions
    touching = box_overlap(found.boxes.detach(), given.truth) > 0
    return attack_loss(_highest(found.classes[..., given.label] * found.objectness, touching))


def every_cell(given: Predicted) -> Tensor:
    """FCA's loss as its public code has it: three terms, of which objectness is of every cell.

    Complete IoU of the assigned boxes; cross-entropy of every cell's objectness, whose target is 0 but for the assigned
    boxes, where it is 1; log-odds of the class on the assigned boxes, no less than 0. Where a detector has no
    objectness, that term is constant.
    """
    found = given.predictions
    overlap = box_overlap(found.boxes, given.truth).detach()
    if overlap.shape[1] == 0:
        return torch.zeros_like(given.score)
    best = overlap.topk(min(ASSIGNED, overlap.shape[1]), 1)
    assigned = torch.zeros_like(overlap).scatter(1, best.indices, (best.values > 0).to(overlap))
    number = assigned.sum(1).clamp(min=1)
    present = -_log_odds_parts(found.objectness)[0]
    absent = attack_loss(found.objectness)
    objectness = torch.where(assigned > 0, present, absent).mean(1)
    closeness = (complete_overlap(found.boxes, given.truth) * assigned).sum(1) / number
    yes, no = _log_odds_parts(found.classes[..., given.label])
    odds = (((yes - no) * assigned).sum(1) / number).clamp(min=0)
    return OVERLAP_WEIGHT * LAYERS * closeness + OBJECTNESS_WEIGHT * BALANCE * objectness + CLASS_WEIGHT * LAYERS * odds


def _log_odds_parts(probability: Tensor) -> tuple[Tensor, Tensor]:
    """log p and log(1 - p), finite with a slope at both ends."""
    return torch.log(probability + SCORE_SHRINK), -attack_loss(probability)


def attention(given: Predicted) -> Tensor:
    """DAS's model attention, see `das`."""
    if given.features is None:
        raise ValueError("attention: the detector's features were not watched")
    return dispersed_attention(given.score, given.features)


def _highest(scores: Tensor, among: Tensor) -> Tensor:
    """(B, N), (B, N) bool -> (B,); 0 where there is none."""
    if scores.shape[1] == 0:
        return scores.new_zeros(len(scores))
    return torch.where(among, scores, 0.0).amax(1)


OBJECTIVES: dict[ObjectiveName, Callable[[Predicted], Tensor]] = {
    "eq6": lambda given: attack_loss(given.score),  # RAUCA's: IoU times class times objectness, the best box
    "complete": complete,
    "log-score": log_score,
    "stealth": stealth,
    "confidence": confidence,
    "every-cell": every_cell,
    "attention": attention,
}
