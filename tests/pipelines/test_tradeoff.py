"""``rauca tradeoff``: which camouflages it makes, and mistakes told before anything is optimized or rendered."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.stability.detectors import SmallDetector
from benchmarks.stability.drawn import make_dataset
from pipelines.cli import app
from pipelines.tradeoff import Sizes, TradeOff, points, run_tradeoff
from rauca_core.attack.naturalness import Naturalness
from rauca_core.contract import Dataset, RaucaError, Vehicle
from rauca_core.report import Curve


def test_points_differ_in_one_thing_each() -> None:
    base = Naturalness(palette=("#102030", "#ffffff"), reference="#8c8c8c")
    found = {point.label: point.natural for point in points(base, (0, 10), (20,))}
    assert list(found) == ["free", "dE-0", "dE-10", "patch-20cm"]
    assert all(wanted is not None and wanted.palette == base.palette for wanted in found.values())
    assert [w.max_delta_e for w in found.values() if w] == [None, 0, 10, None]
    assert [w.feature_cm for w in found.values() if w] == [None, None, None, 20]
    assert [w.reference for w in found.values() if w] == [None, "#8c8c8c", "#8c8c8c", None]
    assert points(None, (), ())[0].natural is None


@pytest.fixture
def small(tmp_path: Path, box_vehicle: Vehicle) -> Dataset:
    return make_dataset(tmp_path / "data", box_vehicle, 64, (40.0,))


@pytest.fixture
def asked(small: Dataset, tmp_path: Path) -> TradeOff:
    sizes = Sizes(steps=2, batch=1, map_size=64, subsamples=1)
    return TradeOff("rauca", small, tmp_path / "out", points(None, (), ()), ("a",), ("a", "b"), ("seen",), sizes)


@pytest.fixture
def curves(monkeypatch: pytest.MonkeyPatch) -> list[Curve]:
    """What is written of studies that are not made; detectors answer to a name other than what was typed."""
    curves: list[Curve] = []

    def named(typed: str, *_: object) -> SmallDetector:
        detector = SmallDetector()
        detector.name = f"{typed}-net"
        return detector

    for module in ("optimize_camouflage", "tradeoff"):
        monkeypatch.setattr(f"pipelines.{module}.load_detector", named)
    monkeypatch.setattr("pipelines.tradeoff.run_study", lambda request: [])
    monkeypatch.setattr("pipelines.tradeoff.write_curve", lambda curve, out: curves.append(curve) or [out])
    return curves


def test_finished_points_are_taken_up_where_all_is_the_same(
    asked: TradeOff, curves: list[Curve], tmp_path: Path, box_vehicle: Vehicle, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_tradeoff(asked)
    finished = {path: path.stat().st_mtime_ns for path in asked.out.rglob("*.*")}
    run_tradeoff(asked)
    assert {path: path.stat().st_mtime_ns for path in asked.out.rglob("*.*")} == finished
    assert [curve.attacked for curve in curves] == [("a-net",)] * 2  # as the study's columns are called

    fewer = make_dataset(tmp_path / "fewer", box_vehicle, 64, (70.0,))
    longer = replace(asked.sizes, steps=3)
    for other, what in (
        (replace(asked, dataset=fewer), "frames"),
        (replace(asked, seed=5), "seed"),
        (replace(asked, sizes=longer), "number of steps"),
    ):
        with pytest.raises(RaucaError, match=f"points/free: made with another {what}; choose another --out"):
            run_tradeoff(other)
    monkeypatch.setattr(SmallDetector, "fingerprint", "4567")
    with pytest.raises(RaucaError, match="made with another detectors"):
        run_tradeoff(asked)


def test_what_is_hidden_is_what_is_measured(asked: TradeOff, tmp_path: Path, box_vehicle: Vehicle) -> None:
    boat = make_dataset(tmp_path / "boat", replace(box_vehicle, category="boat"), 64, (40.0,))
    (free,) = asked.points
    assert asked.settings(free).target == "car"
    assert replace(asked, dataset=boat).settings(free).target == "boat"


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
