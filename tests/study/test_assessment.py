"""What an assessment says, on disk and as a condition of continuous integration."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rauca_core.contract import RaucaError
from rauca_core.study.assessment import Condition, Score, load_assessment, save_assessment
from tests.study.assessments import assessment


def test_an_assessment_comes_back_from_disk(tmp_path: Path) -> None:
    for number, one in enumerate((assessment(), assessment(Score(0.1, 0.0, 0.2, 0.05, 24)))):
        save_assessment(tmp_path / f"{number}.json", one)
        assert load_assessment(tmp_path / f"{number}.json") == one


def test_the_headline_is_one_line_with_the_white_box_where_there_is_one() -> None:
    assert "\n" not in assessment().headline
    assert "made for it" not in assessment().headline
    assert assessment(Score(0.12, 0.0, 0.2, 0.05, 24)).headline.endswith("0.12 in one made for it")


@pytest.mark.parametrize(
    ("condition", "failure"),
    [
        ("transfer_ap=0.5", "transfer_ap is 0.400, below 0.5"),
        ("transfer_ap=0.4", None),
        ("clean_recall=0.95", "clean_recall is 0.900, below 0.95"),
        ("white_box_ap=0.1", "white_box_ap was not measured: it has no gradient"),
    ],
)
def test_conditions_fail_below_their_limit_and_when_nothing_was_measured(condition: str, failure: str | None) -> None:
    assert Condition.parse(condition).failure(assessment()) == failure


def test_a_measured_white_box_meets_its_condition() -> None:
    measured = replace(assessment(), white_box=Score(0.6, 0.5, 0.7, 0.6, 24))
    assert Condition.parse("white_box_low=0.5").failure(measured) is None


@pytest.mark.parametrize("text", ["transfer_ap", "transfer=0.5", "speed_ap=0.5", "transfer_ap=2", "transfer_ap=..", ""])
def test_a_condition_that_cannot_be_read_says_how_to_write_one(text: str) -> None:
    with pytest.raises(RaucaError, match="write FIGURE=LIMIT"):
        Condition.parse(text)
