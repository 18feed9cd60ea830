"""``rauca harden``: what the user types becomes a checked wish, and every mistake is told before any work."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.stability.drawn import make_dataset
from pipelines.cli import app
from rauca_core.attack import random_camouflage
from rauca_core.contract import Camouflage, RaucaError, Vehicle, load_camouflage, load_vehicle, save_camouflage
from rauca_core.contract.files import png_bytes
from rauca_core.runtime.images import read_image


@pytest.fixture
def folder(tmp_path: Path, box_vehicle: Vehicle, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A data set, two camouflages that fit its vehicle and one that does not."""
    data = make_dataset(tmp_path / "data", box_vehicle, 64, (40.0, 130.0))
    vehicle = load_vehicle(data.vehicle_folder, read_image)
    for seed, name in enumerate(("one", "two")):
        random_camouflage(tmp_path / f"{name}.json", vehicle, 64, seed=seed)
    black = png_bytes(np.zeros((2, 2, 3), np.uint8))
    save_camouflage(tmp_path / "stranger.json", Camouflage("x", "tank", "123", 2, "plain"), black)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def harden(*arguments: str) -> str:
    return CliRunner().invoke(app, ["harden", *arguments], catch_exceptions=False).output


GOOD = ["frcnn-synth", "--data", "data", "--held-out", "one=one.json"]


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([*GOOD, "--camouflage", "one.json"], "one.json: the same UV map as one.json; what is trained on cannot"),
        ([*GOOD[:3], "--held-out", "stranger.json"], "stranger.json: made for UV .* of tank, .*; add a data set"),
        ([*GOOD[:3], "--held-out", "adaptive-3x=one.json"], "one.json: cannot be called 'adaptive-3x'"),
        ([*GOOD, "--budgets", "3,1"], "--budgets 3,1: give whole numbers from 1 on, smallest first"),
        ([*GOOD, "--budgets", "many"], "--budgets many: give whole numbers such as 1,3,10, or none"),
        ([*GOOD, "--held-out-method", "ours"], "--held-out-method ours: the hardening is trained on it"),
        (
            [*GOOD, "--held-out-method", "dta", "--attack-method", "ours", "--attack-method", "dta"],
            "dta: the hardening",
        ),
        ([*GOOD, "--held-out-method", "nobody's"], 'method: no "nobody\'s"; choose one of das'),
        ([*GOOD, "--held-out-vehicle", "data"], "data: shows box, which --data shows too; hold another vehicle out"),
        ([*GOOD, "--camouflage", "stranger.json"], "stranger.json: made for UV atlas 123 of tank"),
        ([*GOOD, "--weathers", "hail"], "weather preset 'hail' is unknown"),
        ([*GOOD, "--views", "nowhere"], "nowhere: not a data set"),
        ([*GOOD, "--share", "1"], "share: "),
        ([*GOOD, "--agreement", "97"], "--agreement 97.0: give a share from 0 to 1"),
        ([*GOOD, "--attack-steps", "0", "--budgets", "none"], "nothing to harden against"),
        (["ssd-mobilenet-v2x", *GOOD[1:]], "ssd-mobilenet-v2x"),
    ],
)
def test_mistakes_are_told_before_any_work(folder: Path, arguments: list[str], complaint: str) -> None:
    with pytest.raises(RaucaError, match=complaint):
        harden(*arguments, "--out", "out", "--map-size", "64", "--samples", "4")
    assert not (folder / "out").exists()


def test_a_judge_is_needed(folder: Path) -> None:
    assert "Missing option" in CliRunner().invoke(app, ["harden", "frcnn-synth", "--data", "data", "--out", "x"]).output


SHORT = [
    *("--rounds", "1", "--steps", "1", "--batch", "1", "--attack-steps", "1", "--map-size", "64", "--samples", "2"),
    *("--agreement", "0"),
]


@pytest.fixture
def hardened(folder: Path, box_vehicle: Vehicle, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The arguments of a hardening that was done, but for the judging, on data of two vehicles."""
    mirrored = replace(box_vehicle, name="mirrored", uvs=1 - box_vehicle.uvs, paint_mask=box_vehicle.paint_mask[::-1])
    data = make_dataset(folder / "others", mirrored, 64, (40.0, 130.0))
    random_camouflage(folder / "three.json", load_vehicle(data.vehicle_folder, read_image), 64)

    def judge(*_: object) -> None:
        raise RaucaError("judged")

    monkeypatch.setattr("rauca_core.study.harden.judge", judge)
    arguments = [*GOOD, "--data", "others", "--out", "out", "--threads", "1", *SHORT]
    with pytest.raises(RaucaError, match="judged"):
        harden(*arguments, "--budgets", "1", "--restarts", "1")
    return arguments


def test_what_is_hardened_is_not_hardened_again(folder: Path, hardened: list[str]) -> None:
    (made,) = (folder / "out" / "store" / "hardened").iterdir()
    stamps = {path: path.stat().st_mtime_ns for path in made.rglob("*.*") if path.name != "recipe.json"}
    with pytest.raises(RaucaError, match="judged"):
        harden(*hardened, "--budgets", "1", "--restarts", "1", "--held-out", "two=two.json")
    assert {path: path.stat().st_mtime_ns for path in made.rglob("*.*") if path.name != "recipe.json"} == stamps
    assert (folder / "out" / "hardened-frcnn-synth.safetensors").is_file()
    assert load_camouflage(folder / "out" / "attacks" / "box" / "adaptive-1x" / "camouflage.json")[0].made["steps"] == 1
    with pytest.raises(RaucaError, match="judged"):  # of another vehicle: other data sets are attacked
        harden(*hardened, "--budgets", "1", "--restarts", "1", "--held-out", "three=three.json")
    assert len(list(made.parent.iterdir())) == 2


def test_a_held_out_vehicle_needs_views_of_its_own(folder: Path, hardened: list[str]) -> None:
    given = [*GOOD, "--out", "new", "--held-out-vehicle", "others", "--views", "data"]
    with pytest.raises(RaucaError, match="--views: none shows mirrored, which is held out; give views of it, too"):
        harden(*given)
    assert not (folder / "new").exists()


def test_what_a_round_was_trained_on_cannot_be_held_out(folder: Path, hardened: list[str]) -> None:
    (made,) = (folder / "out" / "store" / "hardened").glob("*/round-1/attack/camouflage.json")
    with pytest.raises(RaucaError, match=r"camouflage.json: the same UV map as .*; what is trained on cannot be held"):
        harden(*hardened, "--budgets", "1", "--restarts", "1", "--held-out", f"x={made}")
