"""``rauca harden``: what the user types becomes a checked wish, and every mistake is told before any work."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.stability.drawn import make_dataset
from pipelines.cli import app
from rauca_core.attack import random_camouflage
from rauca_core.contract import Camouflage, RaucaError, Vehicle, load_vehicle, save_camouflage
from rauca_core.contract.files import png_bytes
from rauca_core.images import read_image


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
        ([*GOOD[:3], "--held-out", "stranger.json"], "stranger.json: made for tank .*; add one of that vehicle"),
        ([*GOOD[:3], "--held-out", "none.json"], "none.json: not found"),
        ([*GOOD[:3], "--held-out", "adaptive=one.json"], "one.json: cannot be called 'adaptive'"),
        ([*GOOD, "--camouflage", "stranger.json"], "stranger.json: made for UV atlas 123 of tank"),
        ([*GOOD, "--weathers", "hail"], "weather preset 'hail' is unknown"),
        ([*GOOD, "--views", "nowhere"], "nowhere: not a data set"),
        ([*GOOD, "--share", "1"], "share: "),
        ([*GOOD, "--precision", "int8"], "precision: "),
        ([*GOOD, "--attack-steps", "0"], "nothing to harden against"),
        ([*GOOD, "--resume"], "out: holds no hardening; start it without resuming"),
        (["ssd-mobilenet-v2x", *GOOD[1:]], "ssd-mobilenet-v2x"),
    ],
)
def test_mistakes_are_told_before_any_work(folder: Path, arguments: list[str], complaint: str) -> None:
    with pytest.raises(RaucaError, match=complaint):
        harden(*arguments, "--out", "out", "--map-size", "64", "--samples", "4")
    assert not (folder / "out").exists()


def test_a_judge_is_needed(folder: Path) -> None:
    assert "Missing option" in CliRunner().invoke(app, ["harden", "frcnn-synth", "--data", "data", "--out", "x"]).output
