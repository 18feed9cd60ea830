"""How sure a detector is that the target is what it is."""

from __future__ import annotations

from torch import Tensor

from ..contract import RaucaError
from .classes import find_class
from .interface import Detector
from .nms import box_iou


def class_index(detector: Detector, category: str) -> int:
    """Index of ``category``, under whichever name the detector's list uses for it.

    Raises:
        RaucaError: the detector has no such class.
    """
    index = find_class(detector.class_names, category)
    if index is None:
        raise RaucaError(
            f"{detector.name}: knows no class {category!r} (its {len(detector.class_names)} are "
            f"{', '.join(detector.class_names[:4])} ...); choose a detector trained on it, or another class"
        )
    return index


def car_score(detector: Detector, images: Tensor, boxes: Tensor, category: str = "car", min_iou: float = 0.3) -> Tensor:
    """Highest objectness * P(car) among the raw predictions on the target; differentiable.

    Args:
        images: (B, 3, H, W) sRGB in [0, 1].
        boxes: (B, 4) xyxy ground truth, pixels.
        min_iou: a prediction is on the target when its box overlaps the truth by more than this.

    Returns:
        (B,) in [0, 1]; 0 where no prediction is on the target.
    """
    found = detector.dense(images)
    scores = found.objectness * found.classes[..., class_index(detector, category)]
    on_target = box_iou(found.boxes, boxes[:, None])[..., 0] > min_iou
    return scores.where(on_target, 0.0).amax(1)
