"""Hardening on the views that a battery attacks on; a stand-in draws what Blender would render."""

from __future__ import annotations

from pathlib import Path

import pytest

from rauca_core.contract import read_plan
from rauca_core.contract.towns import VALIDATION
from rauca_core.detect import load_detector
from rauca_core.detect.synth.card import read_card
from rauca_core.study import battery_hardening
from rauca_core.study.assess import Effort
from rauca_core.study.battery import load_battery
from rauca_core.study.battery_hardening import harden_on_battery
from rauca_core.study.interpolated import Interpolation
from rauca_core.training.settings import HardenSettings
from tests.study.drawn_blender import DrawnBlender, drawn_blender
from tests.study.test_assess import small_battery

__all__ = ["drawn_blender", "small_battery"]


def test_it_learns_where_the_battery_attacks_and_nowhere_that_it_judges(
    small_battery: Path, drawn_blender: DrawnBlender, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = tmp_path / "cache"
    monkeypatch.setattr(battery_hardening, "user_cache", lambda: store)
    monkeypatch.setattr(battery_hardening, "EFFORTS", {"quick": Effort(8, 2)})
    settings = HardenSettings.make(
        steps=1, every=1, batch=1, attack_steps=1, attack_batch=1, map_size=64, samples=2, threads=1
    )
    weights = harden_on_battery(
        "frcnn-synth", tmp_path / "out", battery=str(small_battery), settings=settings,
        interpolation=Interpolation(places=2),
    )  # fmt: skip
    assert load_detector(str(weights)).name == "hardened-frcnn-synth"
    card = read_card(weights.with_suffix(".json").resolve())[0]
    assert [one["name"] for one in card.hardened["camouflages"]] == ["round-1"]
    assert card.hardened["share_of_weights"] == 1.0  # so little was learnt that nothing changed
    battery = load_battery(str(small_battery))
    assert {part["seed"] for part in card.data} == {battery.attack.seed}
    towns = {read_plan(folder).seed for folder in (store / "views").iterdir()}
    assert towns == {battery.attack.seed, VALIDATION["share of a hardening that is kept"]}
