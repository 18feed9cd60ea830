"""What a detector of other people's learns by: truth where a vehicle stands, everywhere else what it said before.

The data marks the vehicles that may wear paint, alone. Taught on it as if nothing else existed, a detector of 80
classes would forget most of them; the network as it was therefore answers for all predictions that lie on no vehicle
(learning without forgetting; Li and Hoiem, 2017). It is shown the same picture with the vehicle in plain paint: of a
camouflaged one it says other things than of a car, plants on doors or the ends of small cars, and must not teach them.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from ..interface import DensePredictions, Detections
from ..nms import box_iou, generalized_iou
from .network import Truth

ANSWER = 3  # predictions that answer for a vehicle
NEAR = 0.3  # overlap above which a prediction is on a vehicle, and is told nothing unless it answers
# From this score on what a detector found elsewhere is truth for losses that know objects alone. It was sure of these:
# taught what it was in doubt of, it sees such things everywhere.
KEPT = 0.5
SMALLEST = 1.0  # pixels, of the sides of a box to keep: frameworks refuse empty ones, which overlap not even themselves
# What is kept weighs more than what is learnt; a weight of 1 is not shown to do worse (docs/hardening-results.md).
BOX_WEIGHT, CLASS_WEIGHT, KEEP_WEIGHT = 1.0, 1.0, 3.0
# Of a probability, in float32: logarithms and their slopes stay finite, and only there. A camouflage that wins drives
# objectness to 1e-6 and below, which is what is to be taught.
LEAST, MOST = 1e-30, 1 - 2**-24


def student_losses(found: DensePredictions, before: DensePredictions, truths: Sequence[Truth]) -> dict[str, Tensor]:
    """Objectness, class and box of the predictions that answer for a vehicle; what was said before elsewhere.

    Args:
        found, before: (B, N) predictions of the network that learns, and of it as it was in the same pictures with the
            vehicles in plain paint; boxes in pixels.
        truths: B of them, boxes in the same pixels.

    Returns:
        Scalars ``present``, ``class``, ``box`` and ``kept``, each a sum divided by the number of vehicles.
    """
    parts = [image_losses(found, before, k, truth) for k, truth in enumerate(truths)]
    vehicles = max(1.0, float(sum(len(t.labels) for t in truths)))
    return {name: torch.stack([part[name] for part in parts]).sum() / vehicles for name in parts[0]}


def image_losses(found: DensePredictions, before: DensePredictions, k: int, truth: Truth) -> dict[str, Tensor]:
    """Sums over the predictions of image ``k``, of parts as in :func:`student_losses`."""
    boxes, objectness, classes = found.boxes[k], found.objectness[k], found.classes[k]
    chosen = box_iou(boxes.detach(), truth.boxes).topk(min(ANSWER, len(boxes)), 0).indices  # (ANSWER, T)
    elsewhere = ~on_vehicle(boxes.detach(), truth.boxes)
    elsewhere[chosen.flatten()] = False
    said, meant = before.objectness[k][elsewhere], before.classes[k][elsewhere]
    kept = cross_entropy(objectness[elsewhere], said).sum()
    kept = kept + (said[:, None] * cross_entropy(classes[elsewhere], meant)).sum()
    # Squared, for 1 - GIoU has a slope where nothing moved; by the score, for YOLOv8's objectness is 1 everywhere.
    was = before.boxes[k][elsewhere]
    moved = 1 - generalized_iou(boxes[elsewhere], was)
    kept = kept + (whole(was) * said * meant.amax(1) * moved.square()).sum()
    labels = functional.one_hot(truth.labels, classes.shape[1]).to(classes).expand(len(chosen), -1, -1)
    hulls = generalized_iou(boxes[chosen], truth.boxes[None])
    share = 1 / len(chosen)
    return {
        "present": share * cross_entropy(objectness[chosen], torch.ones_like(hulls)).sum(),
        "class": CLASS_WEIGHT * share * cross_entropy(classes[chosen], labels).sum(),
        "box": BOX_WEIGHT * share * (1 - hulls).sum(),
        "kept": KEEP_WEIGHT * kept,
    }


def on_vehicle(boxes: Tensor, vehicles: Tensor) -> Tensor:
    """Which of (N, 4) boxes are on one of (T, 4) vehicles: (N,) bool."""
    return (box_iou(boxes, vehicles) > NEAR).any(1)


def whole(boxes: Tensor) -> Tensor:
    """Which of (N, 4) boxes have sides of :data:`SMALLEST` or more: (N,) bool."""
    return (boxes[:, 2:] - boxes[:, :2]).amin(1) >= SMALLEST


def cross_entropy(probability: Tensor, wanted: Tensor) -> Tensor:
    """Of probabilities against wanted ones, elementwise, less the least possible: 0 where the two agree."""
    p, q = probability.clamp(LEAST, MOST), wanted
    least = torch.xlogy(q, q) + torch.xlogy(1 - q, 1 - q)
    return least - torch.xlogy(q, p) - torch.xlogy(1 - q, 1 - p)  # torch's own has no slope below 1e-12


def with_kept(found: Sequence[Detections], truths: Sequence[Truth]) -> list[Truth]:
    """The vehicles, and all that was found in their images and that lies on none of them.

    Args:
        found: by the detector as it was, in B images with the vehicles in plain paint, with a score of :data:`KEPT` or
            more.
        truths: B of them, boxes in the images' pixels.
    """
    return [_beside(truth, one) for truth, one in zip(truths, found, strict=True)]


def _beside(truth: Truth, found: Detections) -> Truth:
    kept = whole(found.boxes) & ~on_vehicle(found.boxes, truth.boxes)
    return Truth(torch.cat([truth.boxes, found.boxes[kept]]), torch.cat([truth.labels, found.labels[kept]]))
