"""Average precision at an overlap of 0.5 for one target per image, as the paper's tables use it (AP@0.5).

The number itself comes from faster-coco-eval, so that it is the one other papers print: COCO's 101-point interpolation,
all areas, the best 100 detections per image.

Detections of one frame never depend on another frame, so a frame's hits and misses are found once (:class:`Ranking`);
leaving frames out only changes how often they count, which makes the average precision of many parts of one set of
frames one matrix product.
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
_RECALLS = np.linspace(0, 1, 101)


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


@dataclass(frozen=True, eq=False)
class Ranking:
    """Every detection of every frame, best first.

    Attributes:
        frame: (N,) the frame it was made in, 0 to F - 1.
        hit: (N,) whether it is the one that finds the frame's target.
        frames: F.
    """

    frame: NDArray[np.int64]
    hit: NDArray[np.bool_]
    frames: int

    @staticmethod
    def of(samples: Sequence[Sample]) -> Ranking:
        """Rank as COCO does: the best 100 of each frame; equal scores in the order of frames, then of detections."""
        frames, scores, hits = [], [], []
        for index, sample in enumerate(samples):
            order = np.argsort(-sample.scores, kind="stable")[:MAX_DETECTIONS]
            overlapping = box_overlaps(sample.boxes[order], sample.truth) >= IOU_THRESHOLD
            first = np.zeros(len(order), bool)
            first[np.flatnonzero(overlapping)[:1]] = True
            frames.append(np.full(len(order), index))
            scores.append(sample.scores[order])
            hits.append(first)
        rank = np.argsort(-np.concatenate(scores), kind="stable")
        return Ranking(np.concatenate(frames)[rank], np.concatenate(hits)[rank], len(samples))

    def part(self, chosen: NDArray[np.int64]) -> Ranking:
        """The ranking of some frames, (P,) ascending; they count from 0 in the result."""
        place = np.full(self.frames, -1)
        place[chosen] = np.arange(len(chosen))
        keep = place[self.frame] >= 0
        return Ranking(place[self.frame[keep]], self.hit[keep], len(chosen))

    def average_precision(self, counts: NDArray[np.int64], cluster: NDArray[np.int64]) -> NDArray[np.float64]:
        """AP@0.5, 101-point interpolation; that of :func:`average_precision`, by another way.

        Args:
            counts: (R, C) how often each cluster counts.
            cluster: (F,) cluster of each frame.

        Returns:
            (R,) in [0, 1].
        """
        found = np.flatnonzero(self.hit)
        if not len(found):
            return np.zeros(len(counts))
        weight = counts.T.astype(np.float64)
        seen = self._up_to_each_hit(found, cluster, len(weight)) @ weight
        true = self._up_to_each_hit(found, cluster, len(weight), self.hit) @ weight
        targets = np.maximum(np.bincount(cluster, minlength=len(weight)) @ weight, 1)  # none: nothing is found
        precision = true / np.maximum(seen, 1)
        envelope = np.maximum.accumulate(precision[::-1])[::-1]  # precision only peaks where a target is found
        reached = np.searchsorted(_RECALLS, true / targets, side="right")
        result: NDArray[np.float64] = (envelope * np.diff(reached, axis=0, prepend=0)).sum(0) / len(_RECALLS)
        return result

    def _up_to_each_hit(
        self,
        found: NDArray[np.int64],
        cluster: NDArray[np.int64],
        clusters: int,
        weight: NDArray[np.bool_] | None = None,
    ) -> NDArray[np.float64]:
        """(H, C): detections of each cluster (weighted) ranked no lower than each of the H hits."""
        before = np.searchsorted(found, np.arange(found[-1] + 1))
        cell = before * clusters + cluster[self.frame[: found[-1] + 1]]
        weights = None if weight is None else weight[: found[-1] + 1].astype(np.float64)
        table = np.bincount(cell, weights, minlength=len(found) * clusters)
        return table.reshape(len(found), clusters).cumsum(0).astype(np.float64)


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


def box_overlaps(boxes: NDArray[np.float64], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Intersection over union of (M, 4) xyxy boxes with one (4,) box: (M,).

    Computed from corners and sides as COCO's tools do, so that an overlap on the edge of 0.5 rounds as theirs.
    """
    sides, truth_sides = boxes[:, 2:] - boxes[:, :2], truth[2:] - truth[:2]
    ends = np.minimum(boxes[:, :2] + sides, truth[:2] + truth_sides)
    shared = np.clip(ends - np.maximum(boxes[:, :2], truth[:2]), 0, None).prod(1)
    return shared / np.maximum(sides.prod(1) + truth_sides.prod() - shared, 1e-12)


def best_score(sample: Sample) -> float:
    """The highest score of a detection that finds the target; 0 where none does."""
    on_target = box_overlaps(sample.boxes, sample.truth) >= IOU_THRESHOLD
    return float(sample.scores[on_target].max(initial=0.0))
