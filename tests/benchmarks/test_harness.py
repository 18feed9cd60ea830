"""What benchmarks share: tables, JSON, a page that keeps its words, and contenders that take turns."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.harness import END, Clock, Results, Settings, fill_page, mark, race
from rauca_core.contract import RaucaError


def test_rows_become_a_table_a_page_and_json(tmp_path: Path) -> None:
    results = Results("trial", Settings(views=2).but(views=3))
    results.add("rows", name="a", step_ms=1.234)
    results.add("rows", name="b", step_ms=float("inf"))
    results.table("Times", {"name": "{name}", "ms": "{step_ms:.1f}"}, results.rows["rows"])
    results.table("Not on the page", {"name": "{name}"}, results.where("rows", name="b"), on_page=False)
    results.target("fast", 1.0, results.one("rows", name="a")["step_ms"], "ms", most=True)
    results.target_table()
    results.publish(tmp_path / "trial.json", tmp_path, "trial.md")
    told = json.loads((tmp_path / "trial.json").read_text())
    assert told["settings"] == {"views": 3}
    assert told["rows"] == [{"name": "a", "step_ms": 1.234}, {"name": "b", "step_ms": None}]
    assert told["targets"][0]["passed"] is False
    page = (tmp_path / "trial.md").read_text()
    assert "### Times\n\n| name | ms |\n|---|---|\n| a | 1.2 |\n| b | inf |\n" in page
    assert "| fast | ≤ 1 ms | 1.234 | FAIL |" in page
    assert "Not on the page" not in page
    with pytest.raises(TypeError, match="no such settings: vews"):
        results.settings.but(vews=1)


def test_a_page_keeps_its_words(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"words\n{mark('render')}\nold\n{END}\nmore\n")
    fill_page(page, "new", "render")
    assert page.read_text() == f"words\n{mark('render')}\n\nnew\n{END}\nmore\n"
    page.write_text("no marks")
    with pytest.raises(RaucaError, match="marks for what is written here are gone"):
        fill_page(page, "new", "render")


def test_contenders_take_turns_and_the_first_round_does_not_count() -> None:
    turns: list[str] = []

    def two_laps(clock: Clock) -> None:
        turns.append("a")
        clock.lap()
        clock.lap()

    laps = race({"a": two_laps, "b": lambda _: turns.append("b")}, rounds=2)
    assert turns == ["a", "b"] * 3
    assert (laps["a"].shape, laps["b"].shape) == ((2, 2), (2, 1))
