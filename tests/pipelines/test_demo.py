"""The whole main job at thumbnail scale: real Blender, real detector, real report."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import pytest

from benchmarks.stability.drawn import make_dataset
from pipelines import demo
from pipelines.demo import DemoChoice, DemoScale, run_demo
from rauca_core.attack import random_camouflage
from rauca_core.contract import load_camouflage, load_vehicle
from rauca_core.runtime.images import read_image
from rauca_core.study import load_results

SMALL = DemoScale(
    frames="--weathers demo --size 128 --samples 2",
    train="--azimuths 3 --elevations 10 --distances 6",
    held_out="--azimuths 2 --elevations 10 --distances 6",
    steps=4,
    batch=2,
)


def test_stages_follow_the_camouflage(tmp_path, monkeypatch):
    done, color = [], ["red"]

    def stands_for(name, product=None):
        def work(*given, **_):
            done.append(name)
            path = product(*given) if product else tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("{}")
            path.with_suffix(".png").write_text(color[0])

        monkeypatch.setattr(demo, name, work)

    stands_for("fetch")
    stands_for("run_blender", lambda job, *_: job.out / "dataset.json")
    stands_for("load_vehicle")
    stands_for("random_camouflage", lambda path, *_, **__: path)
    stands_for("optimize_camouflage", lambda data, detectors, settings, out: out / "camouflage.json")
    stands_for("render_camouflages", lambda job, blender: job.out / "rauca")
    stands_for("measure", lambda *given: tmp_path / "results.json")
    stands_for("compare_renderers", lambda *given: tmp_path / "agreement.json")
    stands_for("report_run")
    monkeypatch.setattr(demo, "read_vehicle_choice", lambda folder: SimpleNamespace(target="car"))

    def run():
        done.clear()
        run_demo(DemoChoice(tmp_path, ["--vehicle", "sedan"]))
        return done[:-1]

    assert len(run()) == 11
    assert run() == []
    (tmp_path / "rauca" / "camouflage.json").unlink()
    color[0] = "blue"
    assert run() == ["optimize_camouflage", "render_camouflages", "measure", "compare_renderers"]


def test_the_demo_runs_resumes_and_reports(tmp_path):
    pytest.importorskip("bpy", reason="the bpy wheel is not installed")
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


def test_a_boat_is_hidden_and_measured_as_a_boat(tmp_path, box_vehicle, monkeypatch):
    boat, seen = replace(box_vehicle, category="boat"), {}

    def drawn(job, *_):
        make_dataset(job.out, boat, 64, (40.0,))

    def optimized(dataset, detectors, settings, out, resume):
        seen["hidden"] = settings.target
        random_camouflage(out / "camouflage.json", load_vehicle(dataset / "vehicle", read_image), 64)

    def evaluated(*_, settings, **more):
        seen["measured"] = settings.category

    monkeypatch.setattr("pipelines.demo.run_blender", drawn)
    monkeypatch.setattr("pipelines.demo.optimize_camouflage", optimized)
    monkeypatch.setattr("pipelines.evaluate.evaluate", evaluated)
    for work in ("render_camouflages", "compare_renderers", "fetch"):
        monkeypatch.setattr(f"pipelines.demo.{work}", lambda *_: None)
    monkeypatch.setattr("pipelines.evaluate.load_detector", lambda *_: None)
    monkeypatch.setattr("pipelines.demo.report_run", lambda out: out)
    run_demo(DemoChoice(tmp_path / "run", ["--vehicle", "boat"], scale=SMALL))
    assert seen == {"hidden": "boat", "measured": "boat"}
