"""Recall along the distance and around the vehicle, on made-up views whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from rauca_core.study.recall import along_distance, around, side_of
from rauca_core.study.results import FrameRow
from rauca_core.study.scores import places_of


def row(azimuth: float, distance: float, place: int = 0) -> FrameRow:
    return FrameRow("f", "noon", azimuth, 0.0, distance, 45.0, 0.0, (0.0, 0.0, 9.0, 9.0), place)


def test_recall_along_the_distance_has_an_interval_over_places() -> None:
    rows = [row(0, distance, place) for distance in (5.0, 10.0) for place in range(8)]
    hits = np.array([1.0] * 8 + [1, 1, 0, 0, 0.5, 0.5, 0, 0])
    near, far = along_distance(rows, hits, places_of(rows)).values()
    assert (near.share, near.views) == (1, 8)
    assert 0.6 < near.low < near.high == 1
    assert far.share == pytest.approx(3 / 8)
    assert 0.05 < far.low < 3 / 8 < far.high < 0.85


def test_a_distance_that_one_place_shows_says_nothing_of_others() -> None:
    rows = [row(0, 5.0, place) for place in range(7)] + [row(0, 9.0, 7)]
    (_, alone) = along_distance(rows, np.ones(8), places_of(rows)).values()
    assert (alone.share, alone.high, alone.views) == (1, 1, 1)
    assert alone.low == pytest.approx(0)


def test_neighbouring_distances_are_taken_together() -> None:
    rows = [row(azimuth, distance) for azimuth in (0, 90) for distance in (5, 6, 8, 10, 12, 14, 16)]
    found = np.arange(14) < 7  # from the front, at every distance
    seen = around(rows, found)
    assert seen.sides == ("front", "left")
    assert seen.bands == ("5-6 m", "8-10 m", "12-14 m", "16 m")
    assert seen.views.tolist() == [[2, 2], [2, 2], [2, 2], [1, 1]]
    assert seen.found.tolist() == [[2, 0], [2, 0], [2, 0], [1, 0]]


@pytest.mark.parametrize(("azimuth", "side"), [(0, "front"), (359, "front"), (45, "front left"), (270, "right")])
def test_sides_have_names(azimuth: float, side: str) -> None:
    assert side_of(azimuth) == side
