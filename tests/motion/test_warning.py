"""Figures of drives whose answers are known by hand."""

from __future__ import annotations

import numpy as np
import pytest

from rauca_core.motion.metrics import Followed
from rauca_core.motion.warning import Drive, braking_m, figures

# From 30 m to 12 m at 10 m/s, ten frames a second: brakes take 5 + 100/14 = 12.14 m.
APPROACH = Drive(np.arange(19) / 10, 30.0 - np.arange(19))


def way(track: list[int], seen: list[bool] | None = None) -> Followed:
    return Followed(np.array(seen or [True] * len(track)), np.array(track))


def test_what_a_late_track_costs():
    found = figures(APPROACH, way([0] * 5 + [1] * 14), 0.5)
    assert found.late_s == pytest.approx(0.5)
    assert found.late_m == pytest.approx(5.0)
    assert found.gap_s == pytest.approx(0.5)
    assert found.blind == 0.0


def test_a_car_that_is_never_known_costs_the_whole_clip():
    found = figures(APPROACH, way([0] * 19), 0.0)
    assert (found.late_s, found.late_m) == (pytest.approx(1.8), pytest.approx(18.0))
    assert found.gap_s == pytest.approx(1.9)
    assert found.blind == 1.0


def test_a_car_hidden_at_first_is_not_late_before_it_appears():
    found = figures(APPROACH, way([0] * 6 + [1] * 13, [False] * 4 + [True] * 15), 0.5)
    assert found.late_m == pytest.approx(2.0)
    assert found.gap_s == pytest.approx(0.2)


def test_breaks_and_gaps_in_the_middle():
    found = figures(APPROACH, way([1] * 4 + [0] * 7 + [2] * 8), 0.5)
    assert (found.breaks, found.switches, found.late_m) == (1, 1, 0.0)
    assert found.gap_s == pytest.approx(0.7)


def test_nobody_brakes_for_a_car_that_drives_away():
    away = Drive(APPROACH.times_s, APPROACH.distances_m[::-1].copy())
    found = figures(away, way([0] * 19), 0.0)
    assert found.blind is None
    assert found.late_m == 0.0
    assert braking_m(np.array([-3.0, 14.0])) == pytest.approx([0.0, 21.0])
