"""Every battery that is shipped can be shown as it was frozen, and the command takes the latest."""

from __future__ import annotations

import inspect

import pytest

from pipelines.assess import assess
from rauca_core.contract import load_camouflage
from rauca_core.contract.assets import assets_folder
from rauca_core.study.battery import LATEST, library_folder, load_battery

SHIPPED = sorted(path.stem for path in (assets_folder() / "batteries").glob("*.json"))


@pytest.mark.parametrize("name", SHIPPED)
def test_its_vehicles_and_camouflages_are_those_that_it_was_frozen_with(name: str) -> None:
    battery = load_battery(name)
    assert battery.name == name
    told = (library_folder() / "README.md").read_text()
    for vehicle, choice in battery.choices():
        for label, path in battery.camouflages_of(vehicle).items():  # refuses other maps
            record, _ = load_camouflage(path)
            assert (record.name, record.atlas_id) == (label, choice.atlas_id)
            assert len(battery.made_against[label]) == len(record.made["detector"].split("+"))
            assert f"| {vehicle.name} | {label} | {record.method} |" in told


def test_the_command_takes_the_latest() -> None:
    assert SHIPPED[-1] == LATEST
    assert inspect.signature(assess).parameters["battery"].default == LATEST


def test_batteries_share_views_so_that_their_camouflages_compare() -> None:
    first, *others = (load_battery(name) for name in SHIPPED)
    assert others
    assert all(other.views == first.views for other in others)
