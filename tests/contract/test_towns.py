"""No town is trained in, chosen in and judged in: in the table, in what studies declare, and in what is shipped."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from rauca_core.contract.assets import assets_folder
from rauca_core.contract.towns import TEST, TRAINING, VALIDATION
from rauca_core.study.ablate import TRAINING_SETS, training_plan
from rauca_core.study.ablations.experiment import QUICK, Sizes
from rauca_core.study.candidates import find_vehicles
from rauca_core.study.demo import DemoScale, views_plan
from rauca_core.study.views import HeldOut

ROOT = Path(__file__).resolve().parents[2]


def use_of(seed: int) -> str:
    """What the town of that seed is for: who is named nowhere is anybody's to train in."""
    named = {town: use for use, towns in (("validation", VALIDATION), ("test", TEST)) for town in towns.values()}
    return named.get(seed, "training")


def test_no_town_has_two_uses() -> None:
    training, validation, test = (set(towns.values()) for towns in (TRAINING, VALIDATION, TEST))
    assert not training & validation
    assert not training & test
    assert not validation & test
    assert [use_of(seed) for seed in (1, 0, 10_000, 20_000, 31_601)] == [
        "training", "training", "validation", "test", "test",
    ]  # fmt: skip


def test_studies_stand_where_the_table_says() -> None:
    sedan = find_vehicles(["sedan"])[0]
    assert use_of(HeldOut().seed) == "test"
    for size in (Sizes(), QUICK):
        assert use_of(size.views.seed) == "validation"
        assert {use_of(training_plan(name, sedan, size).seed) for name in TRAINING_SETS} == {"training"}
    assert use_of(views_plan(sedan, DemoScale(), "train").seed) == "training"
    assert use_of(views_plan(sedan, DemoScale(), "held-out").seed) == "test"


def test_batteries_are_judged_in_test_towns_and_attacked_in_others() -> None:
    files = sorted((assets_folder() / "batteries").glob("*.json"))
    if not files:
        pytest.skip("no battery is shipped yet")
    for file in files:
        battery = json.loads(file.read_text())
        assert use_of(battery["attack"]["seed"]) == "training"
        assert {use_of(views["plan"]["seed"]) for views in battery["views"]} == {"test"}


def test_nothing_that_is_shipped_was_trained_in_a_town_that_judges() -> None:
    assets = assets_folder()
    cards = [assets / "environment" / "light-splitter.json", *(assets / "detectors").glob("*-synth.json")]
    assert len(cards) == 3
    for card in cards:
        data = json.loads(card.read_text())["data"]
        assert {use_of(part["seed"]) for part in data if part.get("use", "train") == "train"} == {"training"}


def test_towns_are_named_nowhere_else() -> None:
    rooms = ("rauca_core", "pipelines", "tools", "benchmarks")
    files = [path for room in rooms for path in (ROOT / room).rglob("*.py") if path.name != "towns.py"]
    named = re.compile(r"^.*(?:(?:TOWN|TRAIN_SEED|TEST_SEED)\w*\s*=\s*\d|\b31_?\d{3}\b).*$", re.MULTILINE)
    again = [f"{path.relative_to(ROOT)}: {line}" for path in files for line in named.findall(path.read_text())]
    assert len(files) > 100
    assert not again
