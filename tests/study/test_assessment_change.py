"""Differences between two assessments of one battery."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from rauca_core.contract import RaucaError
from rauca_core.study.assessment_change import changes
from tests.study.assessments import assessment


def curves(places: np.ndarray) -> tuple[float, ...]:
    """The mean over places without each of them."""
    return tuple(((places.sum() - places) / (len(places) - 1)).tolist())


def test_a_change_is_told_from_chance_in_the_same_places() -> None:
    rng = np.random.default_rng(0)
    old = rng.normal(0.4, 0.2, 24)  # places differ much; both detectors meet the same ones
    new = old + rng.normal(0.05, 0.02, 24)
    score = replace(assessment().clean, ap=float(old.mean()), frames=2400)
    kinds = ("clean", "random", "transfer", "white_box")
    before = replace(
        assessment(), clean=score, random=score, transfer=score, white_box=score,
        without_place=dict.fromkeys(kinds, curves(old)),
    )  # fmt: skip
    after = replace(
        before, transfer=replace(score, ap=float(new.mean())), white_box=replace(score, ap=float(new.mean())),
        without_place=before.without_place | dict.fromkeys(kinds[2:], curves(new)),
    )  # fmt: skip
    clean, random, transfer, white_box = changes(before, after)
    assert (clean.difference, clean.beyond_chance, random.beyond_chance) == (0.0, False, False)
    paired = stats.ttest_rel(new, old)
    assert transfer.beyond_chance
    assert (transfer.low, transfer.high) == pytest.approx(tuple(paired.confidence_interval(0.95)))
    assert transfer.chance == pytest.approx(3 * paired.pvalue)  # the least of three
    assert (white_box.difference, white_box.decided, white_box.beyond_chance) == (transfer.difference, False, False)


@pytest.mark.parametrize("other", [{"budget": "standard"}, {"battery": "assess-2"}, {"vehicles": ("suv",)}])
def test_assessments_of_other_views_are_not_compared(other: dict) -> None:
    with pytest.raises(RaucaError, match="assess both on the same"):
        changes(assessment(), replace(assessment(), **other))


def test_other_places_are_not_compared() -> None:
    fewer = replace(assessment(), without_place=dict.fromkeys(("clean", "random", "transfer"), (0.5,)))
    with pytest.raises(RaucaError, match="so many places: 2, this one of 1"):
        changes(assessment(), fewer)
