"""The simulation behind `rauca bench statistics`, at a size that only shows that it counts right."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.statistics import QUICK, bench, drawn_ranking, without_each


def test_studies_are_simulated_and_counted(tmp_path: Path) -> None:
    few = QUICK.but(studies=40, old_studies=10, means=300, resamples=50, places=(8,), seeds=(2, 5))
    bench(tmp_path / "statistics.json", few)
    found = json.loads((tmp_path / "statistics.json").read_text())
    rows = {(row["what"], row["seeds"]): row for row in found["coverage"]}
    assert {seeds for what, seeds in rows if what == "normal draws"} == {1, 2, 5}
    assert rows["AP .3", 1]["truth"] == pytest.approx(0.3, abs=0.06)
    assert rows["AP .95", 1]["truth"] == pytest.approx(0.95, abs=0.03)
    assert all(0.8 <= row["new"] <= 1 for row in rows.values())
    assert all(row["new_width"] > 0 for row in rows.values())
    two, five = found["luck"]
    assert (two["verdict"], two["family"], five["seeds"]) == (0, 0, 5)  # two seeds: nothing is called
    assert five["family"] < five["family_uncorrected"]


def test_the_simulated_detector_sees_less_where_it_is_harder() -> None:
    once, all_in_one = np.ones((1, 1), np.int64), np.zeros(48, np.int64)
    hard, easy = (
        drawn_ranking(level, np.zeros(8), np.random.default_rng(3)).average_precision(once, all_in_one)[0]
        for level in (-5.6, 1.7)
    )
    assert hard < 0.2 < 0.8 < easy
    assert without_each(np.array([[1.0, 2.0, 6.0]])).tolist() == [[3.0, 4.0, 3.5, 1.5]]
