"""Differences between two assessments of one battery."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rauca_core.contract import RaucaError
from rauca_core.study.assessment_change import changes
from tests.study.assessments import assessment


def test_a_change_is_told_from_chance_by_paired_draws() -> None:
    rng = np.random.default_rng(0)
    chance = rng.normal(0.4, 0.2, 400)  # places differ much; both detectors meet the same ones
    before = replace(assessment(), draws=dict.fromkeys(("clean", "random", "transfer"), tuple(chance.tolist())))
    better = tuple((chance + rng.normal(0.05, 0.01, 400)).tolist())
    after = replace(before, transfer=replace(before.transfer, ap=0.45), draws=before.draws | {"transfer": better})
    clean, random, transfer = changes(before, after)
    assert (clean.difference, clean.beyond_chance, random.beyond_chance) == (0.0, False, False)
    assert transfer.difference == pytest.approx(0.05)
    assert transfer.beyond_chance
    assert 0.02 < transfer.low < 0.05 < transfer.high < 0.08


@pytest.mark.parametrize("other", [{"budget": "standard"}, {"battery": "assess-2"}, {"vehicles": ("suv",)}])
def test_assessments_of_other_views_are_not_compared(other: dict) -> None:
    with pytest.raises(RaucaError, match="assess both on the same"):
        changes(assessment(), replace(assessment(), **other))


def test_other_resamples_are_not_compared() -> None:
    fewer = replace(assessment(), draws=dict.fromkeys(("clean", "random", "transfer"), (0.5,)))
    with pytest.raises(RaucaError, match="2 resamples there, 1 here"):
        changes(assessment(), fewer)
