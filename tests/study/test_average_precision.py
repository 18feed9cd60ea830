"""AP@0.5 against values worked out by hand; against pycocotools in test_coco_agreement."""

from __future__ import annotations

import numpy as np
import pytest

from rauca_core.contract import RaucaError
from rauca_core.study.average_precision import Sample, average_precision

TRUTH = (10.0, 10.0, 50.0, 50.0)
ELSEWHERE = (100.0, 100.0, 140.0, 140.0)


def sample(*detections: tuple[tuple[float, ...], float], truth: tuple[float, ...] = TRUTH) -> Sample:
    boxes = np.array([box for box, _ in detections], np.float64).reshape(-1, 4)
    return Sample(np.array(truth, np.float64), boxes, np.array([score for _, score in detections], np.float64))


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


def test_only_the_best_hundred_detections_count() -> None:
    crowd = [(ELSEWHERE, 0.5 + i / 1000) for i in range(150)]
    assert average_precision([sample(*crowd, (TRUTH, 0.4))]) == 0.0
    assert average_precision([sample(*crowd, (TRUTH, 0.6))]) > 0.0


def test_no_frames_is_an_error() -> None:
    with pytest.raises(RaucaError, match="no frames"):
        average_precision([])
