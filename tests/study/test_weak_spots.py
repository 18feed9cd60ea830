"""Where a detector is weakest, on made-up views whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from rauca_core.contract import RaucaError
from rauca_core.study.results import FrameRow
from rauca_core.study.weak_spots import half_recall_range, worst_cell, worst_tenth


def row(number: int, azimuth: float = 0.0, distance: float = 5.0, weather: str = "noon") -> FrameRow:
    return FrameRow(f"f{number}", weather, azimuth, 0.0, distance, 45.0, 0.0, (0.0, 0.0, 9.0, 9.0))


def test_the_worst_cell_has_the_lowest_recall_then_the_lowest_scores() -> None:
    rows = [row(0), row(1), row(2, 90), row(3, 90), row(4, 90, weather="fog"), row(5, 90, weather="fog")]
    scores = np.array([0.9, 0.1, 0.2, 0.2, 0.1, 0.2])
    worst = worst_cell(rows, scores, 0.25)
    assert (worst.azimuth_deg, worst.distance_m, worst.weather) == (90, 5, "fog")
    assert (worst.recall, worst.frames) == (0, ("f4", "f5"))
    assert worst.score == pytest.approx(0.15)


def test_the_worst_tenth_are_the_views_of_the_lowest_scores() -> None:
    rows = [row(number) for number in range(20)]
    worst = worst_tenth(rows, np.linspace(1, 0, 20), 0.25)
    assert worst.frames == ("f19", "f18")
    assert worst.score == pytest.approx(1 / 38)
    assert worst_tenth(rows[:3], np.array([0.5, 0.1, 0.9]), 0.25).frames == ("f1",)  # never none


def by_distance(*recalls: float) -> tuple[list[FrameRow], np.ndarray]:
    """Ten views at each of 5, 10, 15 ... metres, of which so many are found."""
    rows = [row(0, distance=5.0 * (1 + place)) for place in range(len(recalls)) for _ in range(10)]
    scores = [float(number < 10 * recall) for recall in recalls for number in range(10)]
    return rows, np.array(scores)


@pytest.mark.parametrize(
    ("recalls", "metres", "beyond", "never"),
    [
        ((1.0, 0.8, 0.2), 12.5, False, False),
        ((1.0, 0.4, 0.6, 0.1), 15.0, False, False),  # 0.4 and 0.6 are taken for 0.5 and 0.5
        ((1.0, 1.0), 10.0, True, False),
        ((0.2, 0.1), 5.0, False, True),
        ((0.9,), 5.0, True, False),
    ],
)
def test_range_is_where_recall_falls_below_one_half(
    recalls: tuple[float, ...], metres: float, beyond: bool, never: bool
) -> None:
    found = half_recall_range(*by_distance(*recalls), 0.5)
    assert (found.metres, found.beyond, found.never) == (pytest.approx(metres), beyond, never)


def test_scores_must_fit_the_frames() -> None:
    for rows in ([], [row(0)]):
        with pytest.raises(RaucaError, match="one score a frame"):
            worst_tenth(rows, np.zeros(2), 0.25)
