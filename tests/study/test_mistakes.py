"""Each wrong thing is counted once, and the causes sum to what is wrong."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rauca_core.detect.found import Found
from rauca_core.study.average_precision import box_overlaps
from rauca_core.study.mistakes import Mistakes, mistakes_in

TRUTH = np.array([100.0, 100.0, 200.0, 200.0])
ON, ALSO_ON = (100, 100, 200, 200), (105, 100, 205, 200)
NEAR = (160, 100, 260, 200)  # overlaps by a quarter
AWAY = (300, 300, 340, 340)


def seen(*detections: tuple[tuple[int, int, int, int], float, str]) -> Found:
    ranked = sorted(detections, key=lambda one: -one[1])
    boxes = np.array([box for box, _, _ in ranked], np.float64).reshape(-1, 4)
    return Found(boxes, np.array([score for _, score, _ in ranked], np.float64), tuple(name for *_, name in ranked))


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (seen((ON, 0.9, "car")), Mistakes(1, found=1)),
        (seen((ON, 0.2, "car")), Mistakes(1, missed=1)),
        (seen(), Mistakes(1, missed=1)),
        (seen((ON, 0.9, "truck")), Mistakes(1, wrong_class=1)),
        (seen((ON, 0.9, "truck"), (NEAR, 0.8, "car")), Mistakes(1, wrong_class=1, badly_placed=1)),
        (seen((NEAR, 0.8, "car")), Mistakes(1, badly_placed=1)),
        (seen((NEAR, 0.8, "car"), (AWAY, 0.7, "car")), Mistakes(1, badly_placed=1, invented=1)),
        (seen((ON, 0.9, "car"), (ALSO_ON, 0.8, "car")), Mistakes(1, found=1, seen_twice=1)),
        (seen((ON, 0.9, "car"), (NEAR, 0.8, "car")), Mistakes(1, found=1, badly_placed=1)),
        (seen((ON, 0.9, "car"), (AWAY, 0.8, "truck")), Mistakes(1, found=1)),
        (seen((ON, 0.9, "car"), (ON, 0.8, "truck")), Mistakes(1, found=1)),
    ],
)  # fmt: skip
def test_each_wrong_thing_has_one_cause(found: Found, expected: Mistakes) -> None:
    assert mistakes_in(found, TRUTH, "car", 0.25) == expected


_SIDE = st.integers(0, 300)
_DETECTION = st.tuples(
    st.tuples(_SIDE, _SIDE, st.integers(10, 200), st.integers(10, 200)).map(
        lambda b: (b[0], b[1], b[0] + b[2], b[1] + b[3])
    ),
    st.floats(0, 1),
    st.sampled_from(["car", "truck", "bus"]),
)


@given(st.lists(_DETECTION, max_size=8))
def test_causes_sum_to_what_is_wrong(detections: list[tuple[tuple[int, int, int, int], float, str]]) -> None:
    found = seen(*detections)
    counted = mistakes_in(found, TRUTH, "car", 0.25)
    cars = [i for i, name in enumerate(found.names) if name == "car" and found.scores[i] >= 0.25]
    overlaps = box_overlaps(found.boxes[cars], TRUTH)
    hit = bool((overlaps >= 0.5).any())
    surplus = len(cars) - hit  # detections that find nothing new
    explained = not hit and not counted.wrong_class and counted.badly_placed > 0  # one stands for the target itself
    assert counted.found == hit
    assert counted.wrong == (not hit) + surplus - explained


def test_images_add_up() -> None:
    total = sum([Mistakes(1, found=1), Mistakes(1, missed=1), Mistakes(1, found=1, invented=2)], Mistakes())
    assert total == Mistakes(3, found=2, missed=1, invented=2)
    assert (total.wrong, total.recall) == (3, 2 / 3)
    assert Mistakes().recall == 0
