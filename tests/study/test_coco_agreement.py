"""AP@0.5 by hand, and against pycocotools on random sets made to be awkward."""

from __future__ import annotations

import contextlib
import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rauca_core.contract import RaucaError
from rauca_core.study.average_precision import Ranking, Sample, average_precision

coco = pytest.importorskip("pycocotools.coco", reason="pycocotools is part of the extra `dev`")
cocoeval = pytest.importorskip("pycocotools.cocoeval")

KINDS = ("nothing", "scattered", "duplicates", "crowded", "zero area", "exact halves", "some of each")


def of_pycocotools(samples: list[Sample]) -> float:
    """The reference's AP at 0.5, all areas, best 100 detections per image."""
    truth = coco.COCO()
    annotations = [
        {"id": i, "image_id": i, "category_id": 1, "bbox": xywh(s.truth), "area": 1.0, "iscrowd": 0, "ignore": 0}
        for i, s in enumerate(samples, start=1)
    ]
    images = [{"id": i} for i in range(1, len(samples) + 1)]
    truth.dataset = {"images": images, "annotations": annotations, "categories": [{"id": 1}], "info": {}}
    rows = [
        {"image_id": i, "category_id": 1, "bbox": xywh(box), "score": float(score)}
        for i, s in enumerate(samples, start=1)
        for box, score in zip(s.boxes, s.scores, strict=True)
    ]
    if not rows:
        return 0.0  # pycocotools cannot load an empty list
    with contextlib.redirect_stdout(io.StringIO()):
        truth.createIndex()
        evaluation = cocoeval.COCOeval(truth, truth.loadRes(rows), "bbox")
        evaluation.params.iouThrs, evaluation.params.maxDets = np.array([0.5]), [100]
        evaluation.params.areaRng, evaluation.params.areaRngLbl = [[0, 1e10]], ["all"]
        evaluation.evaluate()
        evaluation.accumulate()
    return float(np.maximum(evaluation.eval["precision"], 0).mean())


def xywh(box: np.ndarray) -> list[float]:
    left, top, right, bottom = box.tolist()
    return [left, top, right - left, bottom - top]


def draw_boxes(rng: np.random.Generator, truth: np.ndarray, kind: str) -> np.ndarray:
    if kind == "nothing":
        return np.zeros((0, 4))
    if kind == "some of each":
        kind = KINDS[rng.integers(0, 6)]
        return draw_boxes(rng, truth, kind)
    if kind == "duplicates":
        return np.repeat(truth[None] + rng.integers(-1, 2, (1, 4)), rng.integers(2, 9), axis=0)
    if kind == "exact halves":  # overlaps of exactly 0.5, and a hair to either side
        half = truth.copy()
        half[2] = (truth[0] + truth[2]) / 2 + rng.choice([-1e-9, 0.0, 1e-9])
        return np.stack([half, truth + np.array([100.0, 0, 100, 0])])
    count = {"scattered": rng.integers(1, 8), "crowded": 130, "zero area": rng.integers(1, 5)}[kind]
    boxes = truth + rng.normal(0, rng.choice([2, 10, 40]), (count, 4)).round(2)
    boxes[:, 2:] = np.maximum(boxes[:, 2:], boxes[:, :2] + (0 if kind == "zero area" else 1))
    if kind == "zero area":
        boxes[0, 2:] = boxes[0, :2]
    return boxes


@settings(max_examples=80, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**31), frames=st.integers(1, 25), kind=st.sampled_from(KINDS), levels=st.integers(1, 12))
def test_agrees_with_pycocotools(seed: int, frames: int, kind: str, levels: int) -> None:
    """``levels``: scores take so few values that many are equal."""
    rng = np.random.default_rng(seed)
    samples = []
    for _ in range(frames):
        corner = rng.uniform(0, 60, 2).round(2)
        truth = np.concatenate([corner, corner + rng.uniform(10, 60, 2).round(2)])
        boxes = draw_boxes(rng, truth, kind)
        samples.append(Sample(truth, boxes, rng.integers(1, levels + 1, len(boxes)) / levels))
    expected = of_pycocotools(samples)
    assert average_precision(samples) == pytest.approx(expected, abs=1e-9)
    once, together = np.ones((1, 1), np.int64), np.zeros(len(samples), np.int64)
    (by_ranking,) = Ranking.of(samples).average_precision(once, together)
    assert by_ranking == pytest.approx(expected, abs=1e-9)


def test_values_by_hand() -> None:
    truth, elsewhere = np.array([10.0, 10.0, 50.0, 50.0]), np.array([100.0, 100.0, 140.0, 140.0])

    def found(*detections: tuple[np.ndarray, float]) -> Sample:
        boxes = np.array([box for box, _ in detections]).reshape(-1, 4)
        return Sample(truth, boxes, np.array([score for _, score in detections]))

    assert average_precision([found((truth, 0.9), (elsewhere, 0.5))]) == pytest.approx(1.0)  # false below every hit
    assert average_precision([found((truth, 0.5), (elsewhere, 0.9))]) == pytest.approx(0.5)
    assert average_precision([found((truth, 0.9)), found()]) == pytest.approx(51 / 101)  # recalls 0, 0.01 .. 0.5
    with pytest.raises(RaucaError, match="no frames"):
        average_precision([])
