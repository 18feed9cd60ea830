"""Average precision at an overlap of 0.5 for one target per image, as the paper's tables use it (AP@0.5).

The number itself comes from faster-coco-eval, so that it is the one other papers print: COCO's 101-point interpolation,
all areas, the best 100 detections per image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from faster_coco_eval import COCO, COCOeval_faster
from numpy.typing import NDArray

from ..contract import RaucaError

IOU_THRESHOLD = 0.5
MAX_DETECTIONS = 100


@dataclass(frozen=True, eq=False)
class Sample:
    """One image with its target and what was detected of the target's class; anything elsewhere is a false positive.

    float64 throughout: the matching compares an overlap with 0.5, and pycocotools does so in float64.

    Attributes:
        truth: (4,) xyxy box of the target, pixels.
        boxes: (M, 4) xyxy detections of the target's class.
        scores: (M,) in [0, 1].
    """

    truth: NDArray[np.float64]
    boxes: NDArray[np.float64]
    scores: NDArray[np.float64]


def average_precision(samples: Sequence[Sample]) -> float:
    """AP@0.5 in [0, 1]; 0 when nothing was detected.

    Raises:
        RaucaError: no samples.
    """
    if not samples:
        raise RaucaError("average precision: no frames to average over")
    truth = COCO(
        {
            "info": {},
            "images": [{"id": i} for i in range(1, len(samples) + 1)],
            "categories": [{"id": 1, "name": "target"}],
            "annotations": [
                _box(i, sample.truth) | {"id": i, "iscrowd": 0} for i, sample in enumerate(samples, start=1)
            ],
        }
    )
    found = truth.loadRes(
        [
            _box(i, box) | {"score": float(score)}
            for i, sample in enumerate(samples, start=1)
            for box, score in zip(sample.boxes, sample.scores, strict=True)
        ]
    )
    evaluation = COCOeval_faster(truth, found, iouType="bbox")
    evaluation.params.imgIds = list(range(1, len(samples) + 1))
    evaluation.params.iouThrs = np.array([IOU_THRESHOLD])
    evaluation.params.areaRng, evaluation.params.areaRngLbl = [[0, 1e10]], ["all"]
    evaluation.params.maxDets = [MAX_DETECTIONS]
    evaluation.evaluate()
    evaluation.accumulate()
    return float(np.maximum(evaluation.eval["precision"], 0.0).mean())


def _box(image: int, box: NDArray[np.float64]) -> dict[str, Any]:
    left, top, right, bottom = box.tolist()
    width, height = right - left, bottom - top
    return {"image_id": image, "category_id": 1, "bbox": [left, top, width, height], "area": width * height}
