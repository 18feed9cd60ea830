"""Write a frozen battery, ``assets/batteries/<name>.json``, and its library of camouflages; see `study/battery.py`.

    python tools/make_battery.py assess-1 LIBRARY

``LIBRARY/<vehicle>/<label>/camouflage.json`` are the camouflages, the same labels for every vehicle, made on
``LIBRARY/<vehicle>/data``, in other places than those below. A battery that is released is never written again: the
next one gets another name.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rauca_core.contract import Dataset, Plan, Quality, RaucaError, Ring, load_camouflage, save_camouflage
from rauca_core.contract.assets import assets_folder
from rauca_core.contract.files import file_digest, write_bytes, write_json
from rauca_core.contract.towns import TEST, TRAINING
from rauca_core.detect import SOURCES, load_detector
from rauca_core.study import recipes
from rauca_core.study.battery import Battery, BatteryVehicle, BatteryViews, library_folder
from rauca_core.study.candidates import find_vehicles
from rauca_core.study.evaluate import RandomPaint
from rauca_core.study.views import RINGS, weathers_named

VEHICLES = ("sedan", "suv")
STREET = RINGS["street"]
_JITTER = {"jitter_azimuth_deg": 15.0, "jitter_elevation_deg": 5.0, "jitter_distance": 0.1, "jitter_aim_m": 0.3}
HIGH = Ring(STREET.azimuths_deg, (35.0, 50.0), (6.0, 10.0, 14.0), **_JITTER)
ATTACK = Ring(STREET.azimuths_deg, (0.0, 8.0, 16.0, 24.0, 45.0), (5.0, 8.0, 12.0, 16.0), **_JITTER)
SEEN, UNSEEN = weathers_named("seen"), weathers_named("unseen")
VIEWS = {
    "street-seen": (STREET, SEEN, TEST["assess-1, street-seen"], {"quick": 5, "standard": 48, "overnight": 192}),
    "street-unseen": (STREET, UNSEEN, TEST["assess-1, street-unseen"], {"quick": 5, "standard": 48, "overnight": 192}),
    "high": (HIGH, (*SEEN, *UNSEEN), TEST["assess-1, high"], {"quick": 4, "standard": 32, "overnight": 128}),
}


def views_plan(ring: Ring, weathers: tuple, seed: int, light: bool) -> Plan:
    """Frames of 320 pixels; fog is composed where it is only optimized on, and rendered where it is judged."""
    return Plan.of(
        weathers, ring, name="battery", size=320, quality=Quality(8, composed_fog=light), light=light, locations=8,
        seed=seed,
    )  # fmt: skip


def keep(folder: Path, label: str, into: Path) -> str:
    """Copy a camouflage into the library; returns the digest of its UV map."""
    record, image = load_camouflage(folder / "camouflage.json")
    save_camouflage(into / f"{label}.json", replace(record, name=label), image.read_bytes())
    return file_digest(into / f"{label}.png")


def fingerprints(folder: Path) -> tuple[str, ...]:
    """Of the detectors that a camouflage was optimized against."""
    names = load_camouflage(folder / "camouflage.json")[0].made["detector"].split("+")
    return tuple(load_detector(name).fingerprint for name in names)


CARD = """# Library of camouflages

UV maps of rauca's own vehicles, which batteries show to detectors ([what for](../../docs/assess.md)). Each was
optimized on rendered streets that no battery judges in (town {town}), against the detectors below and no others.
They are licensed as rauca is, as the vehicles are; [responsible use](../../docs/responsible-use.md) is asked for.
Settings and last losses stand in each JSON file.

| vehicle | camouflage | method | against | licence of the weights | steps | views |
|---|---|---|---|---|---|---|
{rows}
"""


def card_row(folder: Path) -> str:
    """What is known of a camouflage, as a row of a Markdown table."""
    record, _ = load_camouflage(folder / "camouflage.json")
    against = record.made["detector"].split("+")
    licences = ", ".join(dict.fromkeys(SOURCES[name].licence for name in against))
    views = len(Dataset(folder.parent / "data").frames())
    told = (record.method, ", ".join(against), licences, record.made["steps"], views)
    return f"| {folder.parent.name} | {folder.name} | {' | '.join(map(str, told))} |"


def write_card(library: Path, labels: Sequence[str]) -> None:
    """A page beside the camouflages that says what each is."""
    folders = [library / vehicle / label for vehicle in VEHICLES for label in labels]
    town = Dataset(library / VEHICLES[0] / "data").plan.seed
    text = CARD.format(town=town, rows="\n".join(map(card_row, folders)))
    write_bytes(library_folder() / "README.md", text.encode())


def main() -> None:
    """Write the battery; refuse to change one that is there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name")
    parser.add_argument("library", type=Path)
    given = parser.parse_args()
    path = assets_folder() / "batteries" / f"{given.name}.json"
    if path.exists():
        raise RaucaError(f"{path}: a battery never changes; choose another name")
    labels = sorted(one.parent.name for one in (given.library / VEHICLES[0]).glob("*/camouflage.json"))
    vehicles = []
    for choice in find_vehicles(VEHICLES):
        made = {
            label: keep(given.library / choice.name / label, label, library_folder() / choice.name) for label in labels
        }
        content = recipes.vehicle_in(choice.folder).settings["content"]
        vehicles.append(BatteryVehicle(choice.name, content, made))
    battery = Battery(
        name=given.name,
        category="car",
        vehicles=tuple(vehicles),
        made_against={label: fingerprints(given.library / VEHICLES[0] / label) for label in labels},
        random=RandomPaint(),
        attack=views_plan(ATTACK, SEEN, TRAINING["attacks of assess-1"], light=True),
        views=tuple(
            BatteryViews(name, views_plan(ring, weathers, seed, light=False), frames)
            for name, (ring, weathers, seed, frames) in VIEWS.items()
        ),
    )
    write_json(path, battery.to_json())
    write_card(given.library, labels)


if __name__ == "__main__":
    main()
