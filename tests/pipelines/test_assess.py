"""``rauca assess`` as a user types it, over a small battery; a stand-in draws what Blender would render."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from pipelines.cli import app
from rauca_core.contract import RaucaError
from rauca_core.detect import Detector, load_detector
from tests.published import published_weights
from tests.study.drawn_blender import DrawnBlender, drawn_blender
from tests.study.test_assess import small_battery

__all__ = ["drawn_blender", "small_battery"]


@pytest.fixture
def detectors() -> list[Detector]:
    return [load_detector(name) for name in published_weights("yolov4-tiny")]


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["assess", *map(str, arguments)], catch_exceptions=True)


def test_one_command_ends_in_a_headline_a_page_and_an_exit_code(
    small_battery: Path, drawn_blender: DrawnBlender, tmp_path: Path
) -> None:
    out, copy = tmp_path / "out", tmp_path / "result.json"
    asked = ["yolov4-tiny", "--battery", small_battery, "--no-white-box", "--out", out]
    passed = run(*asked, "--fail-below", "clean_ap=0.01", "--json", copy)
    assert passed.exit_code == 0, passed.output
    assert passed.stdout.strip().startswith("yolov4-tiny: AP@0.5 ")
    assert "quick assessment" in passed.stderr
    page = (out / "report.html").read_text()
    assert passed.stdout.strip() in page
    assert json.loads(copy.read_text()) == json.loads((out / "assess.json").read_text())

    drawn = drawn_blender.frames.copy()
    failed = run(*asked, "--fail-below", "white_box_ap=0.1", "--before", copy)
    assert failed.exit_code == 1
    assert "failed: yolov4-tiny: white_box_ap was not measured: it was not asked for" in failed.stderr
    assert drawn_blender.frames == drawn


def test_clips_are_told_apart_from_the_headline(
    small_battery: Path, drawn_blender: DrawnBlender, tmp_path: Path
) -> None:
    pytest.importorskip("trackers")
    asked = ["yolov4-tiny", "--battery", small_battery, "--no-white-box"]
    still = run(*asked, "--out", tmp_path / "still")
    assert still.exit_code == 0, still.output
    out = tmp_path / "driven"
    driven = run(*asked, "--clips", "approach,passing", "--clip-frames", 4, "--frame-rate", 10, "--out", out)
    assert driven.exit_code == 0, driven.output
    told = [json.loads((tmp_path / name / "assess.json").read_text()) for name in ("still", "driven")]
    clips = told[1].pop("clips")
    for one in told:  # all else is what it was without clips
        one.pop("clips", None)
        one.pop("seconds")
        one["detector"].pop("ms_per_image")
    assert told[0] == told[1]
    headline, *table = driven.stdout.splitlines()
    assert headline == still.stdout.strip()
    assert any("2 clips, tracks by bytetrack" in line for line in table)

    rows = {row["paint"]: row for row in clips["rows"]}
    assert set(rows) == {"normal", "random", "theirs"}  # "mine" was made against this very detector
    assert all(row["clips"] == 2 for row in rows.values())
    assert rows["normal"]["lost_m"]["value"] == 0
    assert rows["theirs"]["lost_s"]["low"] <= rows["theirs"]["lost_s"]["value"] <= rows["theirs"]["lost_s"]["high"]
    page = (out / "report.html").read_text()
    assert "On the road: yolov4-tiny, sedan, single" in page
    assert '<a href="clips/clips.html">' in page
    assert "On the road" not in (tmp_path / "still" / "report.html").read_text()
    assert (out / "clips" / "clips.html").is_file()
    kept = json.loads((out / "clips" / "drives.json").read_text())  # by each vehicle; here there is but one
    assert (kept["rows"], kept["clips"]) == (clips["rows"], clips["clips"])


def test_several_detectors_are_compared(small_battery: Path, drawn_blender: DrawnBlender, tmp_path: Path) -> None:
    names = published_weights("yolov4-tiny", "yolov2-tiny")
    told = run(*names, "--battery", small_battery, "--no-white-box", "--out", tmp_path / "out")
    assert told.exit_code == 0, told.output
    assert [line.split(":")[0] for line in told.stdout.splitlines()] == list(names)
    page = (tmp_path / "out" / "report.html").read_text()
    assert all(name in page and (tmp_path / "out" / name / "report.html").is_file() for name in names)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--fail-below", "luck=0.5"], "figures are clean_ap"),
        (["--before", "nowhere.json"], "nowhere.json: not found"),
        (["--battery", "assess-0"], "--battery assess-0: unknown"),
        (["--classes", "car"], "is no OWN=NAME"),
        (["--slurm", "default", "--classes", "car=car"], "drop --classes"),
        (["yolov2-tiny", "--json", "one.json"], "is for one detector"),
        (["other/yolov4-tiny"], "have one name"),
        (["--clips", "flying"], "--clips: flying: clips are any of"),
        (["--clips", "approach", "--clip-weathers", "hail"], "hail"),
    ],
)
def test_mistakes_are_told_before_anything_is_made(
    small_battery: Path, tmp_path: Path, arguments: list[str], complaint: str
) -> None:
    battery = [] if "--battery" in arguments else ["--battery", small_battery]
    told = run("yolov4-tiny", *arguments, *battery, "--out", tmp_path / "out")
    assert isinstance(told.exception, RaucaError)
    assert complaint in str(told.exception)
    assert not (tmp_path / "out").exists()
