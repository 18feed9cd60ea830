"""The whole main job at thumbnail scale: real Blender, real detector, real report."""

from __future__ import annotations

import json

import pytest

from pipelines.demo import DemoChoice, DemoScale, run_demo
from rauca_core.contract import load_camouflage
from rauca_core.evaluate import load_results

pytest.importorskip("bpy", reason="the bpy wheel is not installed")

SMALL = DemoScale(
    frames="--weathers demo --size 128 --samples 2",
    train="--azimuths 3 --elevations 10 --distances 6",
    held_out="--azimuths 2 --elevations 10 --distances 6",
    steps=4,
    batch=2,
)


def test_the_demo_runs_resumes_and_reports(tmp_path):
    choice = DemoChoice(tmp_path / "run", ["--vehicle", "sedan"], scale=SMALL)
    report = run_demo(choice)
    page = report.read_text()
    for paint in ("normal", "random", "rauca"):
        assert paint in page
    results = load_results(choice.out / "results.json")
    assert set(results.table) == {"normal", "random", "rauca"}
    assert len(results.frames) == 2 * 3
    assert set(results.detectors) == {"yolov3-tiny", "yolov4-tiny", "yolov2-tiny"}
    assert load_camouflage(choice.out / "rauca" / "camouflage.json")[0].method == "ours"
    agreement = json.loads((choice.out / "agreement.json").read_text())
    assert agreement["mean_iou"] > 0.97  # at 128 px; at the demo's own size it is above 0.995

    stamps = {p: p.stat().st_mtime_ns for p in choice.out.rglob("*.png")}
    run_demo(choice)
    assert {p: p.stat().st_mtime_ns for p in choice.out.rglob("*.png")} == stamps
