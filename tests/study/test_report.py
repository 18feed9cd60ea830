"""The report: one file, everything inside, and nothing that does not belong to the study."""

from __future__ import annotations

import copy
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

import rauca_core as rauca
from rauca_core.attack.naturalness import Naturalness
from rauca_core.attack.naturalness.reference import Distance
from rauca_core.contract import Camouflage, Dataset, RaucaError, load_camouflage, save_camouflage
from rauca_core.contract.files import png_bytes
from rauca_core.detect import Detector
from rauca_core.report import ReportNotes, save_showcase, write_curve, write_report
from rauca_core.report.before_after import before_after, falls
from rauca_core.report.frames import PLACES, FramePicker, frame_scores, placed_frames, strongest_paint
from rauca_core.report.study_tables import tables_of
from rauca_core.report.table import printed
from rauca_core.study.average_precision import best_score
from rauca_core.study.parts import leading
from rauca_core.study.study import Entry, Study, load_study, save_study
from rauca_core.study.tradeoff import Measured, TradeOff
from tests.study.measured import measure
from tests.study.page import whole_page, written_elsewhere

HOSTILE = "<script>alert(1)</script>"
COMMAND = "rauca evaluate --out <study> & more"


@pytest.fixture(scope="session")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first study made, with the data set it is of, for those that follow to copy."""
    return tmp_path_factory.mktemp("kept")


@pytest.fixture
def study(request: pytest.FixtureRequest, kept: Path, detectors: list[Detector], tmp_path: Path) -> Study:
    """In ``study``: two sets of weathers, a defence, two camouflages, one of hostile name; all really detected in."""
    if (kept / "study").is_dir():
        shutil.copytree(kept, tmp_path, dirs_exist_ok=True)
    else:
        make_study(request.getfixturevalue("scene"), detectors, tmp_path / "study")
        shutil.copytree(tmp_path, kept, dirs_exist_ok=True)
    return load_study(tmp_path / "study")


def make_study(scene, detectors: list[Detector], folder: Path) -> None:
    record, uv_map = load_camouflage(scene.camouflage)
    made = replace(record, name="noise", made={"detector": detectors[0].name})
    save_camouflage(folder / "noise.json", made, uv_map.read_bytes())
    plain = scene.dataset.folder
    renders = {"normal": plain, "noise": scene.noise, HOSTILE: plain}
    seen = [frame.id for frame in scene.dataset.frames() if frame.weather.name != "fog"]
    unseen = [frame.id for frame in scene.dataset.frames() if frame.weather.name == "fog"]
    entries = []
    for weathers, only, defence in (("seen", seen, "none"), ("unseen", unseen, "none"), ("unseen", unseen, "bits")):
        out = folder / weathers / defence
        found = measure(scene.dataset, renders, detectors, out, only=only, defence=defence)
        views, camouflages = scene.dataset.folder, {"noise": folder / "noise.json"}
        entries.append(Entry(weathers, defence, "box", "car", found, out, views, camouflages))
    save_study(folder / "study.json", COMMAND, entries)


def test_the_report_is_one_self_contained_file(study: Study, detectors: list[Detector], tmp_path: Path) -> None:
    steps = np.linspace(1, 0.2, 40)
    notes = ReportNotes(
        title="A small report",
        histories={"noise": {"attack": steps.tolist(), "score": (steps / 2).tolist()}},
        settings={"steps": 40, "smoothness weight": 1e-4},
        commands=["rauca bench render > table.txt"],
        timings_s={"detection": 12.34},
        limitations=["The car is a drawing."],
    )
    out = tmp_path / "study" / "report.html"
    assert [path.suffix for path in write_report(study, out, notes, latex=True)] == [".html", ".csv", ".json", ".tex"]
    text, page = out.read_text(encoding="utf-8"), whole_page(out)
    for words in (
        "A small report",
        HOSTILE,
        "white-box",
        "12.3 s",
        "0.0001",
        "> table.txt",
        COMMAND,
        "95 % interval over",
    ):
        assert words in page.text
    assert "The car is a drawing." in page.text
    # 3 paints x 2 sets of weathers x best, median and worst, for the attacked detector; 1 map
    assert len(page.loads) == 3 * 2 * 3 + 1
    drawings = re.findall(r"<svg role=.*?</svg>", text, re.DOTALL)
    # seen: azimuth, distance, sun; unseen: azimuth, distance; the loss
    assert len(drawings) == 3 + 2 + 1
    assert {"seen/none/results.json", "unseen/bits/results.json", "report.csv", "report.json"} <= set(page.links)


def test_another_process_in_another_folder_writes_the_same_bytes(study: Study, tmp_path: Path) -> None:
    page = rauca.Study.load(tmp_path / "study").report(tmp_path / "study" / "report.html", latex=True)
    code = "import rauca_core as rauca; rauca.Study.load('.').report('report.html', latex=True)"
    written_elsewhere(tmp_path, code, [page.with_suffix(suffix) for suffix in (".html", ".csv", ".json", ".tex")])


def test_the_numbers_are_those_of_the_study(study: Study, detectors: list[Detector], tmp_path: Path) -> None:
    out = tmp_path / "study" / "report.html"
    write_report(study, out)
    page = whole_page(out)
    for entry in study.entries:
        file = f"{entry.weathers}/{entry.defence}/results.json"
        for name in (d.name for d in detectors):
            column = {paint: row[name] for paint, row in entry.results.table.items()}
            order = sorted({printed(e.ap) for paint, e in column.items() if paint != "normal"})
            for paint, estimate in column.items():
                title = (
                    f"{printed(estimate.ap)}, 95 % interval {printed(estimate.low)} to {printed(estimate.high)}; "
                    f"{file}: table / {paint} / {name}"
                )
                cells = [(text, rank) for found, text, rank in page.cells if found == title]
                rank = "" if paint == "normal" else dict(zip(order, "bu", strict=False)).get(printed(estimate.ap), "")
                assert (printed(estimate.ap), rank) in cells
        point = entry.results.groups["azimuth_deg"][0].ap["noise"]
        if entry.defence == "none":
            mean = printed(fmean(point[name] for name in leading(entry.parts)[1]))
            assert any(
                found.startswith(mean) and found.endswith(f"{file}: groups / azimuth_deg / 0 / ap / noise")
                for found, _, _ in page.cells
            )


def test_what_does_not_belong_together_is_refused(study: Study, tmp_path: Path) -> None:
    out = tmp_path / "new" / "report.html"
    camouflage = tmp_path / "study" / "noise.json"
    kept = camouflage.read_text()
    save_camouflage(camouflage, Camouflage("x", "van", "0000", 8, "plain"), png_bytes(np.zeros((8, 8, 3), np.uint8)))
    with pytest.raises(RaucaError, match=r"noise\.json: made for van in another UV layout"):
        write_report(study, out)
    camouflage.unlink()
    with pytest.raises(RaucaError, match=r"noise\.json: "):
        write_report(study, out)
    camouflage.write_text(kept)
    for image in (tmp_path / "noise").glob("*.png"):
        image.write_bytes(image.read_bytes() + b"changed")
    with pytest.raises(RaucaError, match=r"\.png: missing or changed since it was evaluated"):
        write_report(study, out)
    for cache in (tmp_path / "study" / "seen" / "none" / "detections").glob("*.jsonl"):
        cache.write_text("")
    again = replace(study, entries=tuple(replace(entry) for entry in study.entries))  # nothing was read through it yet
    with pytest.raises(RaucaError, match=r"\.jsonl: lacks the detections in .*\.png; evaluate again"):
        write_report(again, out)
    assert not out.parent.exists()


def test_the_average_without_our_own_detectors_has_the_same_intervals(
    study: Study, detectors: list[Detector], tmp_path: Path
) -> None:
    own, published = copy.copy(detectors[1]), detectors[0]
    own.name = "frcnn-synth"
    views, out = Dataset(tmp_path / "dataset"), tmp_path / "out"
    renders = {"normal": views.folder, "noise": tmp_path / "noise"}
    unseen = [frame.id for frame in study.entries[1].results.frames]
    found = measure(views, renders, [own, published], out, only=unseen)
    study = Study("c", (Entry("unseen", "none", "box", "car", found, out),))
    (table,) = tables_of(study)
    assert [column.name for column in table.columns] == ["took no part", "this project's own", published.name, own.name]
    for row in table.blocks[0].rows:
        average, _, alone, _ = row.cells
        assert alone
        assert average
        assert (alone.value, alone.low, alone.high) == (average.value, average.low, average.high)


def test_frames_are_chosen_by_their_rule(study: Study) -> None:
    scores = np.array([0.5, 0.1, 0.9, 0.1, 0.3])
    assert placed_frames(scores, tuple(PLACES)) == [1, 3, 4, 0, 2]
    assert placed_frames(scores[:1], tuple(PLACES)) == [0] * 5
    entry = study.entries[0]
    assert strongest_paint(entry) == "noise"
    for paint in ("normal", "noise"):
        found = frame_scores(entry, paint)
        assert len(found) == len(entry.results.frames)
        assert ((found >= 0) & (found <= 1)).all()
    assert frame_scores(entry, "normal").mean() > found.mean()
    picker = FramePicker([entry])
    assert picker.pictures == len(PLACES) * len(picker.paints)
    title = picker.grid(next(iter(entry.results.detectors))).titles[0]
    best = entry.results.frames[int(np.argmin(found))]
    assert title == f"best\n{best.weather}, {best.azimuth_deg:.0f}°, {best.distance_m:g} m"


def test_without_undefended_views_there_are_no_figures(study: Study, tmp_path: Path) -> None:
    defended = replace(study, entries=study.of(defence="bits"))
    with pytest.raises(RaucaError, match="pictures: no pictures; the box was evaluated with defences only"):
        save_showcase(defended, tmp_path / "pictures")


def test_the_main_figures_are_files_too(study: Study, tmp_path: Path) -> None:
    written = save_showcase(study, tmp_path / "pictures")
    names = [path.name for path in written]
    assert names[:3] == ["grid.jpg", "before-after.jpg", "table.md"]
    assert names[3:] == ["map-noise.jpg", "ap-azimuth.svg", "ap-distance.svg", "ap-sun.svg"]
    with Image.open(written[0]) as sheet:
        assert sheet.height > 3 * 300  # a row per paint
        assert np.asarray(sheet).std() > 20
    table = written[2].read_text().splitlines()
    assert len(table) == 2 + 3
    assert table[2].startswith("| normal | ")
    assert all(line.count("|") == table[0].count("|") for line in table)
    for path in written[4:]:
        drawing = path.read_text()
        assert all(f"<!-- {name} -->" in drawing for name in ("normal", "noise"))  # a line without a name says nothing
        ElementTree.fromstring(drawing)
        assert "var(" not in drawing  # a file has no page to take its colors from


def test_before_and_after_are_one_view_chosen_by_its_fall(study: Study, detectors: list[Detector]) -> None:
    entry = study.entries[0]
    found = falls(entry, detectors[0].name, "normal", "noise")
    by_hand = [
        best_score(entry.recorded.sample(detectors[0].name, "normal", i))
        - best_score(entry.recorded.sample(detectors[0].name, "noise", i))
        for i in range(len(entry.results.frames))
    ]
    assert found.tolist() == by_hand
    sheet = before_after(entry, detectors[0].name)
    assert sheet is not None
    assert sheet.width == 640
    pixels = np.asarray(sheet).astype(int)[60:300]
    assert np.abs(pixels[:, :320] - pixels[:, 320:]).mean() > 1  # two paints
    painted = {name: row for name, row in entry.results.table.items() if name != "normal"}
    assert before_after(replace(entry, results=replace(entry.results, table=painted)), detectors[0].name) is None


def test_the_curve_of_a_tradeoff_shows_every_point(study: Study, detectors: list[Detector], tmp_path: Path) -> None:
    near, far = Distance(1.0, 5.0, 0.8), Distance(40.0, 60.0, 30.0)
    points = (
        Measured("noise", None, None, far, None, None, {"attack": 0.25}),
        Measured(HOSTILE, 5.0, None, near, None, None, {"attack": 0.5}),
    )
    entries = study.of(defence="none")
    asked, attacked = Naturalness(reference="#8c8c8c"), (detectors[0].name,)
    curve = TradeOff(Study(COMMAND, entries), {}, points, attacked, asked)
    written = write_curve(curve, tmp_path / "study" / "tradeoff.html")
    assert [path.suffix for path in written] == [".html", ".csv", ".json", ".tex"]
    page = whole_page(written[0])
    assert HOSTILE in page.text
    assert page.text.count("Against the mean CIELAB distance from the reference") == 2  # sets of weathers
    assert "Against the smallest patch" not in page.text  # one point is no curve
    value = json.loads(written[2].read_text())
    assert (value["reference"], value["black_box"]) == ("#8c8c8c", [detectors[1].name])
    (found,) = [
        line
        for line in value["tables"][0]["values"]
        if (line["row"], line["group"], line["column"]) == ("noise", "Unseen weathers", "white-box")
    ]
    estimate = entries[1].results.table["noise"][detectors[0].name]
    assert (found["value"], found["low"], found["high"]) == (estimate.ap, estimate.low, estimate.high)
    assert found["file"] == "unseen/none/results.json"


def test_a_study_as_a_data_frame(study: Study) -> None:
    frame = study.table()
    rows = frame if isinstance(frame, list) else frame.to_dict("records")
    assert len(rows) == sum(len(row) for entry in study.entries for row in entry.results.table.values())
    entry = study.entries[0]
    paint, detector = "noise", next(iter(entry.results.detectors))
    (found,) = [
        row for row in rows if (row["weathers"], row["paint"], row["detector"]) == (entry.weathers, paint, detector)
    ]
    assert (found["ap"], found["n"]) == (entry.results.table[paint][detector].ap, len(entry.results.frames))
