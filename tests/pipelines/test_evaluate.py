"""``rauca evaluate`` at thumbnail size: real Blender, real detector; and every mistake before Blender starts."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pipelines.cli import app
from rauca_core.contract import Camouflage, Dataset, RaucaError, load_vehicle, save_camouflage
from rauca_core.contract.assets import assets_folder
from rauca_core.contract.files import png_bytes
from rauca_core.runtime.images import read_image
from rauca_core.study.evaluate import Judges
from rauca_core.study.study import Study, load_study
from tests.published import published_weights


def paint(path: Path, color: tuple[int, int, int]) -> Path:
    atlas = load_vehicle(assets_folder() / "vehicles" / "sedan", read_image).atlas_id
    pixels = np.broadcast_to(np.uint8(color), (16, 16, 3)).copy()
    save_camouflage(path, Camouflage(path.stem, "sedan", atlas, 16, "plain"), png_bytes(pixels))
    return path


def evaluate(*arguments: object) -> str:
    return CliRunner().invoke(app, ["evaluate", *map(str, arguments)], catch_exceptions=False).output


def test_a_study_from_views_to_numbers(tmp_path: Path) -> None:
    published_weights("yolov4-tiny")
    pytest.importorskip("bpy", reason="the bpy wheel is not installed")
    out, plain = tmp_path / "study", paint(tmp_path / "plain.json", (255, 0, 0))
    asked = ["--camouflage", plain, "--detectors", "yolov4-tiny", "--weathers", "single", "--defences", "none,bits"]
    asked += [
        "--frames",
        2,
        "--size",
        64,
        "--samples",
        1,
        "--elevations",
        20,
        "--distances",
        5,
        "--fov",
        90,
        "--out",
        out,
    ]
    assert "Car AP@0.5 of the sedan" in evaluate(*asked)
    study = load_study(out)
    assert [(e.vehicle, e.weathers, e.defence) for e in study.entries] == [
        ("sedan", "single", "none"),
        ("sedan", "single", "bits"),
    ]
    for entry in study.entries:
        assert entry.results.paints == ("normal", "plain")
        assert len(entry.results.frames) + len(entry.results.dropped) <= 2
        assert entry.camouflages["plain"].is_file()
        assert entry.views is not None
        assert Dataset(entry.views).plan.ring.fov_deg == 90
    (row, *_), shown = study.entries[0].results.frames, study.entries[0].results.images
    normal, red = (read_image(study.entries[0].folder / shown[p][0].path).astype(int) for p in ("normal", "plain"))
    covered = read_image(out / "sedan" / "single" / "views" / "frames" / row.id / "paint.png") == 255
    assert ((red - normal)[covered] @ (1, -0.5, -0.5)).mean() > 20

    stamps = {path: path.stat().st_mtime_ns for path in out.rglob("*.png")}
    evaluate(*asked)
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*.png")} == stamps
    renders = out / "sedan" / "single" / "renders" / "plain"
    before = {path: path.read_bytes() for path in renders.glob("*.png")}
    paint(plain, (0, 0, 255))  # another map under the same name
    evaluate(*asked)
    assert before
    assert all(path.read_bytes() != old for path, old in before.items())
    views = (path for path in stamps if "views" in path.parts)
    assert all(path.stat().st_mtime_ns == stamps[path] for path in views)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "evaluate: nothing to evaluate; give camouflages, a data set or a --vehicle"),
        (["--vehicle", "cube"], "yolov4-tiny: knows no class 'shape'"),
        (["--vehicle", "sedan", "--detectors", "yolov9"], "yolov9"),
        (["--vehicle", "sedan", "--detectors", "deformable-detr"], "deformable-detr: its weights must be given"),
        (["--vehicle", "sedan", "--defences", "none,armour"], "defence 'armour': unknown; there are none, lgs"),
        (["--vehicle", "sedan", "--weathers", "seen,hail"], "weather preset 'hail' is unknown"),
        (["--vehicle", "sedan", "--weathers", "seen,seen.json"], r"--weathers seen\.json: has the name of seen;"),
        (["--vehicle", "sedan", "--elevations", "high"], "--elevations high: not a comma separated list"),
        (["--vehicle", "sedan", "--device", "warp"], "device warp: torch cannot use it here"),
        (["--vehicle", "tank"], "--vehicle tank: no vehicle folder"),
        (["--camouflage", "none.json"], "none.json: not found"),
        (["stranger.json"], "stranger.json: made for UV atlas 123 of tank, there are aeroplane"),
        (["nowhere"], "nowhere: not a data set"),
    ],
)
def test_mistakes_are_told_before_anything_is_rendered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], complaint: str
) -> None:
    published_weights("yolov4-tiny")
    monkeypatch.chdir(tmp_path)
    shutil.copy(assets_folder() / "weathers" / "unseen.json", "seen.json")
    black = png_bytes(np.zeros((2, 2, 3), np.uint8))
    save_camouflage(tmp_path / "stranger.json", Camouflage("x", "tank", "123", 2, "plain"), black)
    with pytest.raises(RaucaError, match=complaint):
        evaluate(*arguments, "--out", "study", *(() if "--detectors" in arguments else ("--detectors", "yolov4-tiny")))
    assert not (tmp_path / "study").exists()


def test_two_spellings_of_a_defence_are_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    published_weights("yolov4-tiny")
    seen: list[Judges] = []

    def stand_in(engine: object, out: Path, places: object, paints: object, judges: Judges, command: str) -> Study:
        seen.append(judges)
        return Study(command, ())

    monkeypatch.setattr("rauca_core.study.evaluate.judge", stand_in)
    spelled = "none,jpeg,jpeg:quality=75,lgs:block=9,overlap=3,lgs:overlap=3,block=9"
    asked = ["--vehicle", "sedan", "--detectors", "yolov4-tiny", "--defences", spelled, "--out", tmp_path]
    evaluate(*asked)
    assert [defence.name for defence in seen[0].defences] == ["none", "jpeg", "lgs:block=9,overlap=3"]
