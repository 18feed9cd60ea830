"""Held-out views: a balanced part of the published plan."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from rauca_core.contract import Plan, balanced_frames, find_preset
from rauca_core.study.views import HeldOut

WEATHERS = find_preset("enhanced")


def the_plan(held_out: HeldOut | None = None) -> Plan:
    return (held_out or HeldOut()).plan("sedan", "0123456789abcdef", WEATHERS)


def factors(plan: Plan, ids: list[str]) -> np.ndarray:
    """(N, 5): location, weather, azimuth, elevation, distance of each frame, as indices."""
    chosen = [frame for frame in plan.frames() if frame.id in ids]
    values = [(frame.location, frame.weather.name, *plan.ring.nominal(frame.view)) for frame in chosen]
    return np.stack([np.unique(axis, return_inverse=True)[1] for axis in zip(*values, strict=True)], 1)


@pytest.mark.parametrize("count", [32, 128])
def test_values_and_their_pairs_meet_evenly(count: int) -> None:
    plan = the_plan()
    ids = balanced_frames(plan, count)
    assert len(set(ids)) == count
    found, sizes = factors(plan, ids), (8, 16, 8, 4, 4)
    for axis, size in enumerate(sizes):
        times = np.bincount(found[:, axis], minlength=size)
        assert times.max() - times.min() <= 2
    for one, two in combinations(range(5), 2):
        times = np.zeros((sizes[one], sizes[two]))
        np.add.at(times, (found[:, one], found[:, two]), 1)
        even = count / times.size
        assert times.max() <= even + 2
        assert times.min() >= even - 2


def test_a_larger_scale_holds_the_smaller_and_the_largest_is_the_whole_plan() -> None:
    plan = the_plan()
    parts = [set(balanced_frames(plan, count)) for count in (32, 128, 200)]
    assert parts[0] < parts[1] < parts[2]
    small = the_plan(HeldOut(locations=1))
    assert balanced_frames(small, 10**6) == [frame.id for frame in small.frames()]
    other_town = the_plan(HeldOut(seed=7))
    assert set(balanced_frames(other_town, 32)) != parts[0]


def test_large_vehicles_are_seen_from_farther_away() -> None:
    def reaching(length: float) -> np.ndarray:
        return np.float32([[0, 0, 0], [length, 0, 30]])

    assert HeldOut().fitted(reaching(4.8)) == HeldOut()
    assert HeldOut().fitted(reaching(14)).ring.distances_m == (10, 16, 24, 32)
    assert HeldOut(fit=False).fitted(reaching(14)) == HeldOut(fit=False)
