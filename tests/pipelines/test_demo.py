"""The whole main job at thumbnail scale: real Blender, real detector, real report; and what others reuse of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

import rauca_core as rauca
from pipelines.cli import app
from rauca_core.contract import Ring, Vehicle, load_camouflage
from rauca_core.study.demo import DemoScale, demo
from rauca_core.study.study import load_study
from tests.published import published_weights
from tests.study.drawn_blender import DrawnBlender, drawn_blender

__all__ = ["drawn_blender"]
SMALL = DemoScale(
    size=128,
    samples=2,
    train=Ring((0.0, 120.0, 240.0), (10.0,), (6.0,)),
    train_locations=1,
    held_out=Ring((0.0, 180.0), (10.0,), (6.0,)),
    steps=4,
    batch=2,
)
STANDARD = ("yolov3-tiny", "yolov4-tiny", "yolov2-tiny")


def test_the_demo_runs_resumes_and_reports(tmp_path: Path) -> None:
    pytest.importorskip("bpy", reason="the bpy wheel is not installed")
    published_weights(*STANDARD)
    out = tmp_path / "run"
    study = demo(out, scale=SMALL)
    page = rauca.Study.load(out).report(out / "report.html").read_text()
    for paint in ("normal", "random", "ours"):
        assert paint in page
    results = study.entries[0].results
    assert set(results.table) == {"normal", "random", "ours"}
    assert len(results.frames) == 2 * 3
    assert set(results.detectors) == set(STANDARD)
    assert load_camouflage(out / "ours" / "camouflage.json")[0].method == "ours"

    stamps = {p: p.stat().st_mtime_ns for p in out.rglob("*.png")}
    assert demo(out, scale=SMALL).entries == study.entries
    assert {p: p.stat().st_mtime_ns for p in out.rglob("*.png")} == stamps


def test_an_evaluation_on_the_demos_folder_renders_nothing(tmp_path: Path, drawn_blender: DrawnBlender) -> None:
    published_weights(*STANDARD)
    demo(tmp_path / "run", scale=replace(SMALL, size=64))
    before = dict(drawn_blender.frames)
    assert before == {"make_dataset": 9 + 6, "render_camouflages": 6 * 2}
    held_out, camouflage = tmp_path / "run" / "held-out", tmp_path / "run" / "ours" / "camouflage.json"
    asked = [held_out, "--camouflage", camouflage, "--detectors", "yolov3-tiny", "--out", tmp_path / "study"]
    done = CliRunner().invoke(app, ["evaluate", *map(str, asked)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    assert dict(drawn_blender.frames) == before
    assert not (tmp_path / "study" / "store").exists()
    assert len(list((tmp_path / "study" / "sedan" / "held-out" / "renders" / "ours").glob("*.png"))) == 6
    (again,), (first,) = load_study(tmp_path / "study").entries, load_study(tmp_path / "run").entries
    for paint in ("normal", "ours"):
        assert again.results.table[paint]["yolov3-tiny"] == first.results.table[paint]["yolov3-tiny"]


def test_a_boat_is_hidden_and_measured_as_a_boat(
    tmp_path: Path, box_vehicle: Vehicle, drawn_blender: DrawnBlender
) -> None:
    published_weights(*STANDARD)
    replace(box_vehicle, category="boat").save(tmp_path / "boat")
    study = demo(tmp_path / "run", str(tmp_path / "boat"), scale=replace(SMALL, size=64))
    made = load_camouflage(tmp_path / "run" / "ours" / "camouflage.json")[0].made
    assert made["settings"]["target"] == "boat"
    assert study.entries[0].results.settings.category == "boat"
