"""AP@0.5 against an independent plain-Python account of it, and against values worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from rauca_core.contract import RaucaError
from rauca_core.study import Sample, average_precision

TRUTH = (10.0, 10.0, 50.0, 50.0)
ELSEWHERE = (100.0, 100.0, 140.0, 140.0)


def sample(*detections: tuple[tuple[float, ...], float], truth: tuple[float, ...] = TRUTH) -> Sample:
    boxes = np.array([box for box, _ in detections], np.float64).reshape(-1, 4)
    return Sample(np.array(truth, np.float64), boxes, np.array([score for _, score in detections], np.float64))


def plain_average_precision(samples: list[Sample]) -> float:
    """The textbook: rank every detection, walk down, take the best precision at or beyond each of 101 recalls."""
    ranked = []
    for image, one in enumerate(samples):
        best_first = sorted(zip(one.scores.tolist(), one.boxes.tolist(), strict=True), key=lambda pair: -pair[0])
        ranked += [(score, image, box) for score, box in best_first[:100]]
    ranked.sort(key=lambda entry: -entry[0])
    taken: set[int] = set()
    curve = []
    for rank, (_, image, box) in enumerate(ranked, start=1):
        truth = samples[image].truth.tolist()
        width = max(0.0, min(box[2], truth[2]) - max(box[0], truth[0]))
        height = max(0.0, min(box[3], truth[3]) - max(box[1], truth[1]))
        areas = (box[2] - box[0]) * (box[3] - box[1]) + (truth[2] - truth[0]) * (truth[3] - truth[1])
        if width * height / (areas - width * height) >= 0.5:
            taken.add(image)
        curve.append((len(taken) / len(samples), len(taken) / rank))
    total = 0.0
    for hundredth in range(101):
        total += max((precision for recall, precision in curve if recall >= hundredth / 100 - 1e-12), default=0.0)
    return total / 101


def random_samples(count: int, seed: int) -> list[Sample]:
    rng = np.random.default_rng(seed)
    samples = []
    for _ in range(count):
        corner = rng.uniform(0, 60, 2)
        truth = np.concatenate([corner, corner + rng.uniform(20, 60, 2)])
        found = rng.integers(0, 7)
        boxes = truth + rng.normal(0, rng.choice([3, 12, 60]), (found, 4))
        boxes[:, 2:] = np.maximum(boxes[:, 2:], boxes[:, :2] + 1)
        samples.append(Sample(truth, boxes, rng.random(found)))
    return samples


@pytest.mark.parametrize(
    ("samples", "expected"),
    [
        ([sample((TRUTH, 0.9))], 1.0),
        ([sample()], 0.0),
        ([sample((ELSEWHERE, 0.9))], 0.0),
        ([sample((TRUTH, 0.9), (ELSEWHERE, 0.5))], 1.0),  # a false positive below every hit costs nothing
        ([sample((TRUTH, 0.5), (ELSEWHERE, 0.9))], 0.5),  # above it, precision is 1/2 at every recall
        ([sample((TRUTH, 0.9)), sample()], 51 / 101),  # half the targets: recalls 0, 0.01 .. 0.5
        (
            [sample((TRUTH, 0.9), (TRUTH, 0.8)), sample((TRUTH, 0.7))],
            (51 + 50 * 2 / 3) / 101,
        ),  # found twice: one is false
        ([sample(((10.0, 10.0, 50.0, 30.0), 0.9))], 1.0),  # overlap of exactly one half counts
        ([sample(((10.0, 10.0, 50.0, 29.9), 0.9))], 0.0),
    ],
)
def test_cases_worked_out_by_hand(samples: list[Sample], expected: float) -> None:
    assert average_precision(samples) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_agrees_with_the_plain_account(seed: int) -> None:
    samples = random_samples(30, seed)
    expected = plain_average_precision(samples)
    assert 0.02 < expected < 0.98
    assert average_precision(samples) == pytest.approx(expected, abs=1e-9)


def test_only_the_best_hundred_detections_count() -> None:
    crowd = [(ELSEWHERE, 0.5 + i / 1000) for i in range(150)]
    assert average_precision([sample(*crowd, (TRUTH, 0.4))]) == 0.0
    assert average_precision([sample(*crowd, (TRUTH, 0.6))]) > 0.0


def test_no_frames_is_an_error() -> None:
    with pytest.raises(RaucaError, match="no frames"):
        average_precision([])
