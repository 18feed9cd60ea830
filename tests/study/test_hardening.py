"""Before and after: the numbers against their formula, and the page that shows them."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from benchmarks.stability.drawn import make_dataset
from rauca_core.contract import Vehicle
from rauca_core.report import write_hardening
from rauca_core.study.harden import Hardened
from rauca_core.study.hardening import gains_of
from rauca_core.study.study import Entry, Study
from tests.study.colored import BLUE, GREEN, RED, SIZE, FindsColors, paint
from tests.study.measured import measure
from tests.study.page import whole_page


@pytest.fixture
def entry(tmp_path: Path, box_vehicle: Vehicle) -> Entry:
    """Twelve frames; in ``noise`` the vehicle turns blue in six of them and green in three."""
    dataset = make_dataset(tmp_path / "data", box_vehicle, SIZE, (0.0, 60.0, 120.0, 180.0, 240.0, 300.0))
    paint(dataset, tmp_path / "normal", [RED] * 12)
    paint(dataset, tmp_path / "noise", [RED, BLUE, GREEN, BLUE] * 3)
    paints = {name: tmp_path / name for name in ("normal", "noise")}
    detectors = [FindsColors("before", RED), FindsColors("after", RED, BLUE)]
    results = measure(dataset, paints, detectors, tmp_path / "study")
    return Entry("seen", "none", "box", "car", results, tmp_path / "study")


def test_gains_follow_their_formula(entry: Entry) -> None:
    table, gains = entry.results.table, gains_of(entry, "before", "after", ["noise"])
    (noise,) = gains.rows
    assert (noise.paint, entry.results.places) == ("noise", "6 views")
    for gain, name in ((gains.clean, "normal"), (noise, "noise")):
        assert gain.before == table[name]["before"]  # value and interval: the same places as the evaluation's
        assert gain.after == table[name]["after"]
        assert gain.change.ap == pytest.approx(gain.after.ap - gain.before.ap)
        assert gain.change.low <= gain.change.ap <= gain.change.high
    assert (gains.clean.before.ap, gains.clean.after.ap) == (1, 1)
    assert noise.before.ap == pytest.approx(0.25, abs=0.01)  # 3 of 12 on COCO's 101 points
    assert noise.after.ap == pytest.approx(0.75, abs=0.01)
    assert noise.recovered is not None
    assert noise.recovered.ap == pytest.approx(noise.change.ap / (1 - noise.before.ap))
    assert noise.recovered.low <= noise.recovered.ap <= noise.recovered.high
    assert gains.clean.recovered is None  # nothing was lost there
    assert gains.held_out.recovered == noise.recovered


def test_a_detector_that_did_not_change_recovers_nothing(entry: Entry) -> None:
    recovered = gains_of(entry, "before", "before", ["noise"]).rows[0].recovered
    assert recovered is not None
    assert recovered.ap == 0
    assert -0.2 < recovered.low < 0 < recovered.high < 0.2  # a quarter of a frame, as Student's t sees it


def test_the_page_and_its_files_hold_the_same_numbers(entry: Entry, tmp_path: Path) -> None:
    gains, study = gains_of(entry, "before", "after", ["noise"]), Study("rauca harden <x>", (entry,))
    found = Hardened(tmp_path / "x", "before", "after", study, [gains], {"noise": "<b>drawn</b>"}, {"rounds": 2})
    page, table, numbers, _ = write_hardening(found, tmp_path / "report.html")
    read = whole_page(page)
    assert "<b>drawn" in read.text
    assert len(read.loads) == 2 * 2 * 5  # paints, before and after, places
    assert f"{gains.rows[0].after.ap:.3f}" in read.text
    rows = {(row["row"], row["column"]): row for row in csv.DictReader(table.open())}
    assert {row for row, _ in rows} == {"normal", "noise", "held-out, mean"}
    assert ("normal", "recovered") not in rows
    assert float(rows["noise", "after"]["value"]) == gains.rows[0].after.ap
    assert float(rows["noise", "recovered"]["low"]) == gains.rows[0].recovered.low
    assert rows["noise", "after"]["keys"] == "table / noise / after"
    assert json.loads(numbers.read_text())["before"] == "before"
