"""`rauca optimize --method`: the method's settings, under what the user typed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from benchmarks.stability.detectors import SmallDetector
from benchmarks.stability.drawn import make_dataset
from pipelines.cli import app
from rauca_core.attack import OptimizerSettings, make_settings, optimizer
from rauca_core.attack.methods import METHODS, settings_of
from rauca_core.attack.naturalness import Naturalness
from rauca_core.contract import Dataset, RaucaError, Vehicle
from rauca_core.detect import Detector


@pytest.fixture
def chosen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, box_vehicle: Vehicle) -> Any:
    """The settings that a command line ends up with, on a data set of a ``category``."""

    def settings(*options: str, category: str = "car") -> OptimizerSettings:
        data, seen = make_dataset(tmp_path / category, replace(box_vehicle, category=category), 64, (40.0,)), []

        def run(dataset: Dataset, detectors: object, settings: OptimizerSettings, *_: object) -> None:
            seen.append(settings)
            raise RaucaError("seen")

        monkeypatch.setattr(optimizer, "load_detector", lambda *_, **__: SmallDetector())
        monkeypatch.setattr(optimizer, "run_optimization", run)
        with pytest.raises(RaucaError, match="seen"):
            CliRunner().invoke(app, ["optimize", str(data.folder), "--out", "x", *options], catch_exceptions=False)
        return seen[0]

    return settings


def test_without_a_method_it_is_ours(chosen: Any) -> None:
    ours = make_settings(**settings_of("ours", weights=(2.0,), roa=False, detector_size=320))
    assert chosen("--weight", "2", "--no-roa") == ours


def test_only_the_panel_of_ours_is_shown_pictures_of_a_size_of_its_own(chosen: Any) -> None:
    assert chosen("--detector", "yolov3-tiny").detector_size is None
    assert chosen("--detector-size", "416").detector_size == 416
    assert chosen().detector_size == METHODS["ours"].panel_size
    assert chosen("--defence", "jpeg").detector_size == METHODS["ours"].panel_size


@pytest.mark.parametrize("name", METHODS)
def test_a_method_replaces_defaults(chosen: Any, name: str) -> None:
    assert chosen("--method", name) == make_settings(**settings_of(name, detector_size=METHODS[name].panel_size))


def test_detectors_behind_a_defence(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, box_vehicle: Vehicle) -> None:
    """Those named, or the method's own panel, are attacked through it."""
    data, seen = make_dataset(tmp_path / "data", box_vehicle, 64, (40.0,)), []

    def load(name: str, *_: object, **__: object) -> Detector:
        small = SmallDetector()
        small.name = name
        return small

    def run(dataset: Dataset, detectors: Sequence[Detector], *_: object) -> None:
        seen.append([detector.name for detector in detectors])
        raise RaucaError("seen")

    monkeypatch.setattr(optimizer, "load_detector", load)
    monkeypatch.setattr(optimizer, "run_optimization", run)
    asked = ["optimize", str(data.folder), "--out", "x", "--method", "fca", "--defence", "jpeg:quality=50"]
    for options in ((), ("--detector", "mine")):
        with pytest.raises(RaucaError, match="seen"):
            CliRunner().invoke(app, [*asked, *options], catch_exceptions=False)
    assert seen == [["yolov3-tiny+jpeg:quality=50"], ["mine+jpeg:quality=50"]]
    with pytest.raises(RaucaError, match="defence 'fog': unknown; there are none, lgs"):
        CliRunner().invoke(app, [*asked[:-1], "fog"], catch_exceptions=False)


def test_typed_options_win(chosen: Any) -> None:
    found = chosen("--method", "fca", "--light", "none", "--beta", "0.01", "--name", "fca plain", "--weight", "3")
    assert (found.light, found.beta, found.name, found.weights) == ("none", 0.01, "fca plain", (3.0,))
    assert (found.method, found.paint, found.limit, found.samples) == ("fca", "facets", "tanh", 2)


def test_published_or_adapted(chosen: Any, tmp_path: Path) -> None:
    weights = str(tmp_path / "efe.safetensors")
    found = chosen("--method", "rauca-final", "--as", "published", "--extractor", weights, "--map-size", "64")
    asked = settings_of("rauca-final", "published", extractor=Path(weights), map_size=64)
    assert found == make_settings(**asked)
    assert (found.sampler, found.samples, found.batch, found.name) == ("uv-traversal", 2, 1, "rauca-final-published")
    assert chosen("--method", "fca", "--as", "adapted") == chosen("--method", "fca")


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--as", "published"), "--as published: ours was never published"),
        (("--method", "fca", "--as", "printed"), "--as: no 'printed'; choose published or adapted"),
    ],
)
def test_forms_that_there_are_not(tmp_path: Path, options: tuple[str, ...], told: str) -> None:
    with pytest.raises(RaucaError, match=told):
        CliRunner().invoke(app, ["optimize", str(tmp_path), "--out", "x", *options], catch_exceptions=False)


def test_methods_are_printed_with_what_differs() -> None:
    found = CliRunner().invoke(app, ["methods", "rauca-final"]).output
    assert "as its code says" in found
    assert "uv-traversal" in found
    assert "one form only" in CliRunner().invoke(app, ["methods", "ours"]).output
    assert "as its paper says" in CliRunner().invoke(app, ["methods", "dta"]).output


def test_a_methods_symmetry_stays_beside_what_is_typed(chosen: Any) -> None:
    natural = Naturalness(palette=("#1b2a1b", "#4b5320"), symmetric=True)
    typed = ("--method", "ours", "--palette", "#1b2a1b,#4b5320")
    assert chosen(*typed).natural == natural
    assert chosen(*typed, "--feature-size", "20").natural == natural.model_copy(update={"feature_cm": 20.0})
    assert chosen("--method", "fca", *typed[2:]).natural == natural.model_copy(update={"symmetric": False})


def test_both_sides_alike_or_not(chosen: Any) -> None:
    ours = chosen("--method", "ours")
    assert ours.natural == Naturalness(symmetric=True)
    assert chosen("--method", "ours", "--symmetric") == ours
    assert chosen("--method", "ours", "--asymmetric").natural is None
    assert chosen("--method", "fca", "--symmetric").natural == Naturalness(symmetric=True)
    assert chosen("--method", "fca", "--asymmetric").natural is None
    assert chosen("--method", "ours", "--asymmetric", "--palette", "#000000").natural.symmetric is False


@pytest.mark.parametrize("method", [(), ("--method", "ours")])
def test_what_is_hidden_is_the_vehicles_own_class(chosen: Any, method: tuple[str, ...]) -> None:
    assert chosen(*method, category="boat").target == "boat"
    assert chosen(*method, category="shape").target == "car"  # no detector knows a shape
    assert chosen(*method, "--target", "truck", category="boat").target == "truck"


def test_methods_are_documented() -> None:
    page = (Path(__file__).parents[2] / "docs" / "methods.md").read_text()
    for name, method in METHODS.items():
        assert f"## {name}" in page
        assert method.source in page
