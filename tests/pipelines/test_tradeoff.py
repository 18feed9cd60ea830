"""``rauca tradeoff``: which camouflages it makes, and mistakes told before anything is optimized or rendered."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from benchmarks.stability.detectors import SmallDetector
from benchmarks.stability.drawn import make_dataset
from pipelines.cli import app
from rauca_core.attack.naturalness import Naturalness
from rauca_core.contract import Dataset, RaucaError, Vehicle, load_camouflage
from rauca_core.study.study import Study
from rauca_core.study.tradeoff import Sizes, TradeOff, points, tradeoff


def test_points_differ_in_one_thing_each() -> None:
    base = Naturalness(palette=("#102030", "#ffffff"), reference="#8c8c8c")
    found = points(base, (0, 10), (20,))
    assert list(found) == ["free", "dE-0", "dE-10", "patch-20cm"]
    assert all(wanted is not None and wanted.palette == base.palette for wanted in found.values())
    assert [w.max_delta_e for w in found.values() if w] == [None, 0, 10, None]
    assert [w.feature_cm for w in found.values() if w] == [None, None, None, 20]
    assert [w.reference for w in found.values() if w] == [None, "#8c8c8c", "#8c8c8c", None]
    assert points(None, (), ()) == {"free": None}


@pytest.fixture
def small(tmp_path: Path, box_vehicle: Vehicle) -> Dataset:
    return make_dataset(tmp_path / "data", box_vehicle, 64, (40.0,))


class Named(SmallDetector):
    """Answers to a name other than what was typed."""

    def __init__(self, name: str, fingerprint: str) -> None:
        super().__init__()
        self.name, self.fingerprint = name, fingerprint


def test_points_are_optimized_once_and_anew_for_what_changes(
    small: Dataset, tmp_path: Path, box_vehicle: Vehicle, monkeypatch: pytest.MonkeyPatch
) -> None:
    detectors = Named("a-net", "01"), Named("b-net", "02")
    monkeypatch.setattr("rauca_core.study.tradeoff.judge", lambda *_: Study("", ()))
    sizes = Sizes(steps=2, batch=1, map_size=64, subsamples=1)

    def run(data: Dataset = small, white_box: Named = detectors[0], **chosen: Any) -> TradeOff:
        asked = {"sizes": sizes, "attacked": [white_box], "detectors": [detectors[1]], "threads": 1} | chosen
        return tradeoff(data, points(None, (), ()), tmp_path / "out", **asked)

    found = run()
    assert found.attacked == ("a-net",)  # as the study's columns are called
    assert load_camouflage(found.camouflages["free"])[0].made["settings"]["target"] == "car"
    stamps = {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "store" / "paint").rglob("*.png")}
    assert run() == found
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "store" / "paint").rglob("*.png")} == stamps

    fewer = make_dataset(tmp_path / "fewer", box_vehicle, 64, (70.0,))
    boat = make_dataset(tmp_path / "boat", replace(box_vehicle, category="boat"), 64, (40.0,))
    others = [run(fewer), run(seed=5), run(sizes=replace(sizes, steps=3)), run(white_box=Named("c", "03")), run(boat)]
    assert len({found.camouflages["free"], *(other.camouflages["free"] for other in others)}) == 6
    assert load_camouflage(others[-1].camouflages["free"])[0].made["settings"]["target"] == "boat"
    assert (tmp_path / "out" / "points" / "free").resolve() == others[-1].camouflages["free"].parent.resolve()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--max-delta-e", "5,10"], "--reference"),
        (["--reference", "#8c8c8c", "--max-delta-e", "5,x"], "--max-delta-e"),
        (["--reference", "#8c8c8c", "--max-delta-e", "5,2000"], "--max-delta-e 5,2000: not a comma separated list"),
        (["--reference", "#8c8c8c", "--feature-size", "0,5"], "--feature-size"),
        (["--reference", "none.png"], "not found"),
        (["--reference", "#8c8c8c", "--detectors", "yolov3-tiny"], "--detectors"),
        (["--reference", "#8c8c8c", "--weathers", "hail"], "hail"),
    ],
)
def test_mistakes_are_told(small: Dataset, tmp_path: Path, options: list[str], words: str) -> None:
    done = CliRunner().invoke(app, ["tradeoff", str(small.folder), "--out", str(tmp_path / "out"), *options])
    assert isinstance(done.exception, RaucaError)
    assert words in str(done.exception)
    assert not (tmp_path / "out").exists()
