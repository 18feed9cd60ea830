"""Suppression against the textbook loop, detections against an exhaustive list, and how sure a detector is."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from benchmarks.vehicle import car_score
from rauca_core.detect import DarknetDetector, DensePredictions, box_iou
from rauca_core.detect.nms import detections, suppress


def plain_iou(a: list[float], b: list[float]) -> float:
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    if width <= 0 or height <= 0:
        return 0.0
    areas = (a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1])
    return width * height / (areas - width * height)


def plain_nms(boxes: list[list[float]], threshold: float) -> list[int]:
    kept: list[int] = []
    for index, box in enumerate(boxes):
        if all(plain_iou(box, boxes[other]) <= threshold for other in kept):
            kept.append(index)
    return kept


def random_boxes(count: int, seed: int) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    corner = torch.rand(count, 2, generator=generator, dtype=torch.float64) * 60
    return torch.cat([corner, corner + torch.rand(count, 2, generator=generator, dtype=torch.float64) * 50], 1)


@given(count=st.integers(0, 60), seed=st.integers(0, 10_000), threshold=st.sampled_from([0.0, 0.2, 0.45, 0.8]))
@settings(deadline=None, max_examples=60)
def test_suppress_is_greedy(count: int, seed: int, threshold: float) -> None:
    boxes = random_boxes(count, seed)
    assert suppress(boxes, threshold).nonzero()[:, 0].tolist() == plain_nms(boxes.tolist(), threshold)


@pytest.mark.parametrize("kind", [torch.float32, torch.float64, torch.bfloat16])
def test_suppression_goes_by_the_very_overlaps_of_box_iou(kind: torch.dtype) -> None:
    """Of each label by itself, and where boxes are empty, inverted, endless or no numbers."""
    boxes = random_boxes(400, 5)
    boxes[::7, 2:] = boxes[::7, :2]
    boxes[3::11, 2:] -= 70
    boxes[5::13, 2] = torch.inf
    boxes[8::17, 1] = torch.nan
    boxes, labels = boxes.to(kind), torch.arange(400) // 150
    exact = boxes.float() if kind is torch.bfloat16 else boxes
    overlaps = (box_iou(exact, exact) > 0.3) & (labels[:, None] == labels)
    kept: list[int] = []
    for index in range(400):
        if not overlaps[index, kept].any():
            kept.append(index)
    assert suppress(boxes, 0.3, labels).nonzero()[:, 0].tolist() == kept
    assert 50 < len(kept) < 350


def test_box_iou_matches_the_plain_formula() -> None:
    a, b = random_boxes(12, 1), random_boxes(9, 2)
    expected = torch.tensor([[plain_iou(x, y) for y in b.tolist()] for x in a.tolist()], dtype=torch.float64)
    torch.testing.assert_close(box_iou(a, b), expected)
    empty = torch.tensor([[5.0, 5.0, 5.0, 5.0], [9.0, 9.0, 3.0, 3.0]])
    assert (box_iou(empty, empty) == 0).all()


def test_detections_suppress_each_class_on_its_own() -> None:
    torch.manual_seed(0)
    boxes = random_boxes(80, 4)[None].float()
    predictions = DensePredictions(boxes, torch.rand(1, 80), torch.rand(1, 80, 3))
    (found,) = detections(predictions, 0.3, 0.4)
    expected = set()
    for category in range(3):
        scores = (predictions.objectness * predictions.classes[..., category])[0]
        candidates = [i for i in scores.argsort(descending=True).tolist() if scores[i] > 0.3]
        kept = plain_nms([boxes[0, i].tolist() for i in candidates], 0.4)
        expected |= {(category, round(scores[candidates[k]].item(), 5)) for k in kept}
    pairs = zip(found.labels.tolist(), found.scores.tolist(), strict=True)
    assert {(label, round(score, 5)) for label, score in pairs} == expected
    assert found.scores.diff().le(0).all()


def test_nothing_above_the_threshold_gives_empty_detections() -> None:
    predictions = DensePredictions(torch.zeros(2, 5, 4), torch.zeros(2, 5), torch.ones(2, 5, 3))
    found = detections(predictions, 0.005, 0.45)
    assert [(one.boxes.shape, one.scores.shape, one.labels.dtype) for one in found] == [((0, 4), (0,), torch.int64)] * 2


def test_car_score_is_the_best_prediction_on_the_target(detector: DarknetDetector) -> None:
    torch.manual_seed(1)
    images = torch.rand(3, 3, 48, 64)
    found = detector.dense(images)
    targets = found.boxes[torch.arange(3), torch.tensor([5, 40, 90])]
    scores = car_score(detector, images, targets)
    for image in range(3):
        best = 0.0
        for box, objectness, classes in zip(
            found.boxes[image], found.objectness[image], found.classes[image], strict=True
        ):
            if box_iou(box[None], targets[image, None])[0, 0] > 0.3:
                best = max(best, (objectness * classes[1]).item())
        assert best > 0
        assert scores[image].item() == pytest.approx(best)
    assert car_score(detector, images[:1], targets[:1] + 1e4).tolist() == [0.0]
