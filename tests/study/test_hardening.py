"""Before and after: the numbers against their formula, and the page that shows them."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.stability.drawn import make_dataset
from rauca_core.contract import Vehicle
from rauca_core.detect.agreement import Agreement
from rauca_core.report import write_hardening
from rauca_core.study.harden import Hardened
from rauca_core.study.harden_measures import Measures
from rauca_core.study.hardening import gains_of
from rauca_core.study.hardening_record import Cost, Figures, Round
from rauca_core.study.other_classes import FrameAgreement, OtherClasses
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
    cost = Cost(7.25, (Round(1, 0.9, 0.4, 3.0), Round(2, 0.9, None, 4.25)))
    others = OtherClasses((FrameAgreement(1, 0, Agreement(8, 9, 4, 4), Agreement(1, 1, 1, 1)),))
    figures = Figures("before", "after", [gains], [others], cost)
    found = Hardened(tmp_path / "x", study, figures, {"noise": "<b>drawn</b>"}, {"rounds": 2})
    page, table, numbers, _ = write_hardening(found, tmp_path / "report.html")
    read = whole_page(page)
    assert "<b>drawn" in read.text
    assert len(read.loads) == 2 * 2 * 5  # paints, before and after, places
    assert f"{gains.rows[0].after.ap:.3f}" in read.text
    assert "Of 10 objects beside the vehicle" in read.text
    assert "the other says the same of 90.0% (95 % interval 0% to 100% over 1 place" in read.text
    assert "Of the 5 that before was sure of, after still finds 5." in read.text
    assert "7.2 CPU minutes" in read.text
    every = list(csv.DictReader(table.open()))
    assert {row["row"] for row in every} == {
        *("normal", "noise", "held-out, mean"), *("own paint", "held-out camouflages"), *("1", "2"),
        *("box, seen", "all"),
    }  # fmt: skip
    rows = {(row["row"], row["column"]): row for row in every}
    assert float(rows["box, seen", "the same"]["value"]) == 0.9
    assert rows["all", "objects"]["value"] == "10"
    assert ("normal", "recovered") not in rows
    assert float(rows["noise", "after"]["value"]) == gains.rows[0].after.ap
    assert float(rows["noise", "recovered"]["low"]) == gains.rows[0].recovered.low
    assert rows["noise", "after"]["keys"] == "table / noise / after"
    assert json.loads(numbers.read_text())["before"] == "before"

    more = {"seen": OtherClasses((FrameAgreement(2, 0, Agreement(), Agreement(10, 10, 5, 5)),))}
    wider = replace(found, figures=replace(figures, other_places=more))
    page, table, *_ = write_hardening(wider, tmp_path / "wider.html")
    read = whole_page(page)
    assert "Of 20 objects beside the vehicle" in read.text
    assert "the other says the same of 95.0% (95 % interval" in read.text
    assert "over 2 places; one object counts once in each paint" in read.text
    rows = {(row["row"], row["column"]): row for row in csv.DictReader(table.open())}
    assert float(rows["box, seen", "the same"]["value"]) == 0.9
    assert float(rows["more places, seen", "the same"]["value"]) == 1
    assert rows["more places, seen", "objects"]["keys"] == "other_places / seen / objects"
    assert rows["all", "objects"]["value"] == "20"


@pytest.fixture
def attacked(tmp_path: Path, box_vehicle: Vehicle) -> Entry:
    """Twelve frames; a held-out camouflage, one of a held-out method, and two that know the hardened detector."""
    dataset = make_dataset(tmp_path / "data", box_vehicle, SIZE, (0.0, 60.0, 120.0, 180.0, 240.0, 300.0))
    worn = {
        "normal": [RED] * 12, "noise": [BLUE, GREEN] * 6, "method-dta": [BLUE] * 6 + [GREEN] * 6,
        "adaptive-1x": [BLUE] * 9 + [GREEN] * 3, "adaptive-3x": [BLUE] * 3 + [GREEN] * 9,
    }  # fmt: skip
    for name, colors in worn.items():
        paint(dataset, tmp_path / name, colors)
    detectors = [FindsColors("before", RED), FindsColors("after", RED, BLUE)]
    results = measure(dataset, {name: tmp_path / name for name in worn}, detectors, tmp_path / "study")
    return Entry("seen", "none", "box", "car", results, tmp_path / "study")


def test_the_record_holds_the_entry_that_ends_lowest_and_names_failed_attacks(attacked: Entry, tmp_path: Path) -> None:
    measures = Measures(budgets=(1, 3), methods=("dta",))
    gains = gains_of(attacked, "before", "after", ["noise"], measures)
    assert gains.failed == ("adaptive-1x",)  # 9 of 12 found, of the held-out one 6
    assert set(gains.adaptive) == {1, 3}
    others = OtherClasses((
        FrameAgreement(1, 0, Agreement(3, 4, 1, 2), Agreement()),
        FrameAgreement(1, 1, Agreement(), Agreement(5, 6, 3, 3)),
        FrameAgreement(1, 2, Agreement(), Agreement()),
    ))  # fmt: skip
    figures = Figures("before", "after", [gains], [others], Cost(1.5, ()), frozenset({"seen"}))
    record = json.loads(figures.save(tmp_path).read_text())
    assert record["failed_attacks"] == ["adaptive-1x, box, seen"]
    assert record["other_classes_agreement"] == 0.8
    assert record["other_classes_kept"] == 0.8
    assert record["pictures_without_vehicle"] == {"agreed": 3, "objects": 4, "kept": 1, "known": 2}
    told = record["other_classes"]
    assert (told["agreement"], told["objects"], told["views"], told["places"]) == (0.8, 10, 2, 2)
    assert record["entries"][0]["other_classes"] == told
    assert record["other_places"] == {}
    more = OtherClasses((FrameAgreement(2, 0, Agreement(), Agreement(2, 10, 0, 1)),))
    wider = json.loads(replace(figures, other_places={"seen": more}).save(tmp_path).read_text())
    assert wider["other_places"]["seen"] == more.told()
    assert wider["entries"][0]["other_classes"] == told
    assert (wider["other_classes"]["agreement"], wider["other_classes"]["places"]) == (0.5, 3)
    assert record["adaptive_3x"] == {
        "before": 0, "after": pytest.approx(0.25, abs=0.01), "low": gains.adaptive[3].after.low,
        "high": gains.adaptive[3].after.high, "recovered": pytest.approx(0.25, abs=0.01),
    }  # fmt: skip
    assert record["adaptive_10x"] is None
    assert record["held_out_methods"]["after"] == pytest.approx(0.5, abs=0.01)
    assert record["held_out_weathers"] == record["held_out"]
    assert record["held_out_vehicle"] is None
    assert record["clean"]["after"] == 1
    assert record["entries"][0]["adaptive_1x"] == record["adaptive_1x"]
    elsewhere = replace(gains, entry=replace(attacked, weathers="unseen"), held_out=gains.adaptive[3])
    both = replace(figures, gains=[gains, elsewhere]).worst()
    assert both["held_out"] is gains.adaptive[3]
    assert both["held_out_weathers"] is gains.held_out
