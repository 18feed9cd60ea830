"""RT-DETR's losses: each object is answered for by one prediction, all others say that nothing is there.

As in transformers, boxes (L1 and generalized IoU) count for the chosen predictions, and classes by the varifocal loss,
whose goal is the overlap.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from ..nms import box_iou
from .network import Truth

CLASS_WEIGHT, L1_WEIGHT, GIOU_WEIGHT = 1.0, 5.0, 2.0
CLASS_COST, L1_COST, GIOU_COST = 2.0, 5.0, 2.0
FOCAL_ALPHA, VARIFOCAL_ALPHA, GAMMA = 0.25, 0.75, 2.0

Matches = list[tuple[Tensor, Tensor]]
"""Per image: indices of predictions, and of the objects that they answer for."""


def corners(boxes: Tensor) -> Tensor:
    """(..., 4) center and size -> xyxy."""
    center, half = boxes[..., :2], boxes[..., 2:] / 2
    return torch.cat([center - half, center + half], -1)


def centered(boxes: Tensor) -> Tensor:
    """(..., 4) xyxy -> center and size."""
    return torch.cat([(boxes[..., :2] + boxes[..., 2:]) / 2, boxes[..., 2:] - boxes[..., :2]], -1)


def generalized_iou(a: Tensor, b: Tensor) -> Tensor:
    """Of xyxy boxes (..., 4) that broadcast against each other: (...) in [-1, 1] (Rezatofighi et al., 2019)."""
    shared = torch.minimum(a[..., 2:], b[..., 2:]) - torch.maximum(a[..., :2], b[..., :2])
    shared_area = shared.clamp(min=0).prod(-1)
    area_a, area_b = ((x[..., 2:] - x[..., :2]).clamp(min=0).prod(-1) for x in (a, b))
    union = (area_a + area_b - shared_area).clamp(min=1e-9)
    hull = torch.maximum(a[..., 2:], b[..., 2:]) - torch.minimum(a[..., :2], b[..., :2])
    hull_area = hull.clamp(min=0).prod(-1).clamp(min=1e-9)
    return shared_area / union - (hull_area - union) / hull_area


@torch.no_grad()
def match(logits: Tensor, boxes: Tensor, truths: Sequence[Truth]) -> Matches:
    """The cheapest assignment of every image; of more objects than predictions, the largest are answered for.

    Args:
        logits: (B, N, C).
        boxes: (B, N, 4) center and size, fractions of the image.
        truths: boxes likewise.
    """
    from scipy.optimize import linear_sum_assignment  # not at the top: only who trains needs it

    matches = []
    for one_logits, one_boxes, truth in zip(logits, boxes, truths, strict=True):
        area = truth.boxes[:, 2:].prod(1)
        which = area.topk(min(len(area), len(one_boxes))).indices.sort().values
        labels, goals = truth.labels[which], truth.boxes[which]
        probability = one_logits.sigmoid()[:, labels]
        present = FOCAL_ALPHA * (1 - probability) ** GAMMA * -(probability + 1e-8).log()
        absent = (1 - FOCAL_ALPHA) * probability**GAMMA * -(1 - probability + 1e-8).log()
        apart = torch.cdist(one_boxes, goals, p=1)
        overlap = generalized_iou(corners(one_boxes)[:, None], corners(goals)[None])
        cost = CLASS_COST * (present - absent) + L1_COST * apart - GIOU_COST * overlap
        _, answering = linear_sum_assignment(cost.T.double().cpu().numpy())
        chosen = torch.from_numpy(answering).to(one_boxes.device)
        matches.append((chosen, which))
    return matches


def layer_losses(
    logits: Tensor, boxes: Tensor, truths: Sequence[Truth], matches: Matches, objects: float
) -> dict[str, Tensor]:
    """Losses of one layer's predictions, divided by the number of ``objects``; shapes as of :func:`match`."""
    image = torch.cat([torch.full_like(chosen, k) for k, (chosen, _) in enumerate(matches)])
    place = image, torch.cat([chosen for chosen, _ in matches])
    goal = torch.cat([t.boxes[which] for t, (_, which) in zip(truths, matches, strict=True)])
    labels = torch.cat([t.labels[which] for t, (_, which) in zip(truths, matches, strict=True)])
    found = boxes[place]
    overlap = box_iou(corners(found.detach())[:, None], corners(goal)[:, None])[:, 0, 0]
    hot, wanted = torch.zeros_like(logits), torch.zeros_like(logits)
    hot[*place, labels], wanted[*place, labels] = 1.0, overlap
    weight = VARIFOCAL_ALPHA * logits.detach().sigmoid() ** GAMMA * (1 - hot) + wanted
    classes = functional.binary_cross_entropy_with_logits(logits, wanted, weight, reduction="sum")
    hulls = generalized_iou(corners(found), corners(goal))
    return {
        "classes": CLASS_WEIGHT * classes / objects,
        "l1": L1_WEIGHT * (found - goal).abs().sum() / objects,
        "giou": GIOU_WEIGHT * (1 - hulls).sum() / objects,
    }
