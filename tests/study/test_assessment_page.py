"""What people read of an assessment: its page and numbers, a comparison of several, and ``rauca.assess``."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rauca_core as rauca
from benchmarks.stability.drawn import make_dataset
from rauca_core.contract import RaucaError, Vehicle
from rauca_core.report import Robustness, Study, robustness, write_assessment, write_comparison
from rauca_core.report.assessment_tables import paints_of, shown_range
from rauca_core.report.worst_views import ViewPicker
from rauca_core.study.assess import WHITE_BOX, summarize
from rauca_core.study.assessment import Assessed, Assessment, load_assessment, save_assessment
from rauca_core.study.battery import Battery, BatteryViews
from rauca_core.study.evaluate import RandomPaint
from rauca_core.study.pooled import Pool
from rauca_core.study.study import Entry, load_study, save_study
from rauca_core.study.weak_spots import Range
from tests.study.colored import BLUE, GREEN, RED, SIZE, FindsColors, paint
from tests.study.drawn_blender import DrawnBlender, drawn_blender
from tests.study.measured import measure
from tests.study.page import whole_page, written_elsewhere
from tests.study.test_assess import small_battery

__all__ = ["drawn_blender", "small_battery"]
HOSTILE = "<b>theirs</b>"
SIDES = (0.0, 90.0, 180.0, 270.0)
COLORS = {  # of eight views: four sides by day, then at dusk
    "normal": [GREEN, *[RED] * 7],
    "random": [GREEN, BLUE, *[RED] * 6],
    HOSTILE: [RED, *[BLUE] * 4, *[RED] * 3],
    "mine": [BLUE] * 8,
    WHITE_BOX: [BLUE] * 8,
}
NOTE = "one run of 2 steps"


@pytest.fixture
def study(tmp_path: Path, box_vehicle: Vehicle) -> Study:
    """Eight views in five paints; ``mine`` finds red cars, ``other`` blue ones, too."""
    dataset = make_dataset(tmp_path / "data", box_vehicle, SIZE, SIDES)
    folders = {name: tmp_path / "paints" / str(number) for number, name in enumerate(COLORS)}
    for name, colors in COLORS.items():
        paint(dataset, folders[name], colors)
    entries = []
    for defence in ("none", "bits"):
        out = tmp_path / "out" / "box" / defence
        detectors = [FindsColors("mine", RED), FindsColors("other", RED, BLUE)]
        found = measure(dataset, folders, detectors, out, defence=defence)
        entries.append(Entry("street", defence, "box", "car", found, out))
    save_study(tmp_path / "out" / "study.json", "rauca assess <x>", entries)
    return Study.load(tmp_path / "out")


def summarized(study: Study, detector: str, tmp_path: Path) -> Assessment:
    """Of one of the study's detectors; the camouflage ``mine`` was made against that of this name."""
    plan = rauca.Dataset(tmp_path / "data").plan
    views = BatteryViews("street", plan, dict.fromkeys(("quick", "standard", "overnight"), 8))
    made = {HOSTILE: ("f" * 8,), "mine": ("f00d1",)}
    battery = Battery("small", "car", (), made, RandomPaint(), plan, (views,))
    prints = study.entries[0].results.detectors
    assessed = Assessed(detector, "color", prints[detector], True, "", 12.5)
    found = summarize(assessed, battery, "quick", 0.25, study)
    found = replace(found, white_box_note=NOTE, seconds={"rendering": 61.5})
    save_assessment(tmp_path / "out" / "assess.json", found)
    return found


@pytest.fixture
def found(study: Study, tmp_path: Path) -> Assessment:
    return summarized(study, "mine", tmp_path)


def test_the_page_says_first_what_matters_and_is_one_file(found: Assessment, study: Study, tmp_path: Path) -> None:
    page, *others = write_assessment(found, study, tmp_path / "out" / "report.html")
    assert [path.suffix for path in others] == [".csv", ".json", ".tex"]
    read = whole_page(page)
    places = [read.text.index(words) for words in (found.headline, "The worst views", "By paint", "Limitations")]
    assert places == sorted(places)
    for words in (HOSTILE, NOTE, "rauca assess <x>", "12.5 ms", "61.5 s", "Bit depth", "upper bound", "8 views of box"):
        assert words in read.text
    assert "Made against this very detector, and so left out of transfer: mine." in read.text
    # Of seven found views HOSTILE loses four and the white box all, of which five are shown; normal stands above.
    assert len(read.loads) == 2 * 4 + 2 * 5 + 1
    assert f"lost in {HOSTILE}: 4 of 8 views" in read.text
    assert "Missed even in normal paint: 1 of 8 views" in read.text


def test_files_hold_the_numbers_of_the_assessment(found: Assessment, study: Study, tmp_path: Path) -> None:
    _, table, numbers, _ = write_assessment(found, study, tmp_path / "out" / "report.html")
    rows = {(row["table"], row["row"], row["group"], row["column"]): row for row in csv.DictReader(table.open())}
    written = json.loads((tmp_path / "out" / "assess.json").read_text())
    for paint_name, (score, keys) in paints_of(found).items():
        row = rows["paints", paint_name, "", "AP@0.5"]
        assert [float(row[name]) for name in ("value", "low", "high")] == [score.ap, score.low, score.high]
        place = written
        for key in row["keys"].split(" / "):
            place = place[key]
        assert (place, row["file"]) == (score.ap, "assess.json")
        assert keys == tuple(row["keys"].split(" / ")[:-1])
    causes = ("missed", "wrong class", "badly placed", "seen twice", "invented")
    for paint_name, counted in found.errors.items():
        told = [float(rows["errors", paint_name, "", cause]["value"]) for cause in causes]
        assert sum(told) == float(rows["errors", paint_name, "", "wrong, all"]["value"]) == counted.wrong
    assert float(rows["errors", HOSTILE, "", "missed"]["value"]) == 4
    seen = {column: row["value"] for (key, _, _, column), row in rows.items() if key == "around-normal"}
    assert seen == {"front": "1 of 2", "left": "2 of 2", "rear": "2 of 2", "right": "2 of 2"}
    assert json.loads(numbers.read_text())["detector"]["sha256"] == "f00d1"


def test_the_worst_views_are_those_lost_most_surely(found: Assessment, study: Study) -> None:
    entries = study.of(defence="none")
    pool = Pool(entries, "mine", lambda entry: 0)
    lost = ViewPicker(entries, pool, "mine", 0.25).lost_in(HOSTILE)
    assert (lost.many, lost.of) == (4, 8)
    assert lost.grid is not None
    assert list(lost.grid.rows) == ["normal", HOSTILE]
    assert all("normal 0.90" in title and f"{HOSTILE} 0.00" in title for title in lost.grid.titles)
    assert {title.split(", ")[1] for title in lost.grid.titles} == {"front", "left", "rear", "right"}
    assert ViewPicker(entries, pool, "mine", 0.95).lost_in(HOSTILE).grid is None  # nothing is found surely enough


def test_what_changed_is_told_from_chance(found: Assessment, study: Study, tmp_path: Path) -> None:
    worse = tuple(np.array(found.without_place["transfer"]) - 0.2)
    transfer = replace(found.transfer, ap=found.transfer.ap - 0.2)
    before = replace(found, transfer=transfer, without_place={**found.without_place, "transfer": worse})
    read = whole_page(write_assessment(found, study, tmp_path / "out" / "report.html", before)[0])
    assert "changed beyond chance: transfer, mean +0.200 (+0.1" in read.text
    assert (
        "not to be told from chance: normal, random; undecided, as each was attacked by itself: white-box +0.000"
        in read.text
    )
    assert "What changed" not in whole_page(write_assessment(found, study, tmp_path / "out" / "plain.html")[0]).text
    with pytest.raises(RaucaError, match="assess both on the same"):
        write_assessment(found, study, tmp_path / "new" / "report.html", replace(before, budget="standard"))
    assert not (tmp_path / "new").exists()


def test_a_black_box_says_why_it_was_not_attacked(found: Assessment, study: Study, tmp_path: Path) -> None:
    errors = {name: one for name, one in found.errors.items() if name != WHITE_BOX}
    detector = replace(found.detector, differentiable=False, why_not="it is a function", sha256="")
    black = replace(found, detector=detector, white_box=None, white_box_note="it is a function", errors=errors)
    read = whole_page(write_assessment(black, study, tmp_path / "out" / "report.html", latex=False)[0])
    for words in ("Not attacked itself: it is a function.", "not possible: it is a function", "cannot be identified"):
        assert words in read.text
    assert f"lost in {WHITE_BOX}" not in read.text


def test_another_process_in_another_folder_writes_the_same_page(
    found: Assessment, study: Study, tmp_path: Path
) -> None:
    written = write_assessment(found, study, tmp_path / "out" / "report.html")
    code = (
        "from pathlib import Path; from rauca_core.report import Study, write_assessment;"
        "from rauca_core.study.assessment import load_assessment;"
        "write_assessment(load_assessment(Path('assess.json')), Study.load('.'), Path('report.html'))"
    )
    written_elsewhere(tmp_path, code, written)


def test_detectors_are_compared_best_first(found: Assessment, study: Study, tmp_path: Path) -> None:
    other = summarized(study, "other", tmp_path)
    assert other.transfer.ap > found.transfer.ap
    own = [write_assessment(one, study, tmp_path / one.detector.name / "report.html")[0] for one in (found, other)]
    page, table, *_ = write_comparison([found, other], tmp_path / "comparison.html", own)
    read = whole_page(page)
    assert read.links[-5:-3] == ["mine/report.html", "other/report.html"]
    assert "AP@0.5 is highest for other; beyond chance below it: mine." in read.text
    rows = [row for row in csv.DictReader(table.open()) if row["column"] == "transfer"]
    assert [row["row"] for row in rows] == ["other", "mine"]
    assert [float(row["value"]) for row in rows] == [other.transfer.ap, found.transfer.ap]
    with pytest.raises(RaucaError, match=r"different budget \(quick of mine, standard of other\)"):
        write_comparison([found, replace(other, budget="standard")], tmp_path / "comparison.html")
    with pytest.raises(RaucaError, match="no assessment"):
        write_comparison([], tmp_path / "comparison.html")


def test_ranges_are_read_without_a_legend() -> None:
    assert shown_range(Range(12.345, beyond=False, never=False)) == "12.3 m"
    assert shown_range(Range(16.0, beyond=True, never=False)) == "16 m or more"
    assert shown_range(Range(5.0, beyond=False, never=True)) == "less than 5 m"


def test_the_face_of_an_assessment(found: Assessment, study: Study, tmp_path: Path) -> None:
    found_out = Robustness(found, study)
    assert found_out.headline == found.headline
    rows = found_out.table()
    rows = rows if isinstance(rows, list) else rows.to_dict("records")
    assert [row["paint"] for row in rows] == list(paints_of(found))
    assert rows[0]["ap"] == found.clean.ap
    assert found_out.passes("clean_recall=0.8", "transfer_ap=0.1")
    assert not found_out.passes("clean_recall=0.8", "white_box_ap=0.5")
    with pytest.raises(RaucaError, match="write FIGURE=LIMIT"):
        found_out.passes("robust")
    page = found_out.report(tmp_path / "out" / "report.html", before=tmp_path / "out" / "assess.json")
    assert "What changed" in whole_page(page).text


def test_a_name_stays_a_name_and_what_is_loaded_keeps_its_classes(
    found: Assessment, study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    monkeypatch.setattr(robustness.assessing, "assess", lambda *given, **options: asked.append(given) or (found, study))
    rauca.assess("yolov3-tiny", out=tmp_path)  # a task of a cluster loads it by that
    rauca.assess(FindsColors("mine", RED), out=tmp_path)
    assert asked[0] == ("yolov3-tiny", tmp_path)
    assert asked[1][0].name == "mine"
    with pytest.raises(RaucaError, match="give names and classes to load_detector"):
        rauca.assess(FindsColors("mine", RED), names=("car",), out=tmp_path)


@pytest.mark.usefixtures("drawn_blender")
def test_a_detector_is_assessed_from_python(
    small_battery: Path, drawn_blender: DrawnBlender, detectors, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robustness, "user_cache", lambda: tmp_path / "user")
    asked = {"battery": str(small_battery), "white_box": False}
    first = rauca.assess(detectors[0], **asked)
    drawn = drawn_blender.frames.copy()
    again = rauca.assess(detectors[0], **asked)
    assert drawn_blender.frames == drawn
    assert replace(again.assessment, seconds={}, detector=first.assessment.detector) == replace(
        first.assessment, seconds={}
    )
    folders = list((tmp_path / "user").rglob("assess.json"))
    assert len(folders) == 1  # the same question comes back to the same folder
    assert load_assessment(folders[0]).headline == first.headline
    page = whole_page(first.report(tmp_path / "report.html"))
    assert "it was not asked for" in page.text
    assert first.passes("clean_ap=0.1")
    assert len(load_study(folders[0].parent).entries) == 2
