"""Write a frozen battery, ``assets/batteries/<name>.json``, and add to the library of camouflages (`study/battery.py`).

    python tools/make_battery.py assess-4 LIBRARY --shipped texels-seven

``LIBRARY/<vehicle>/<label>/camouflage.json`` are new camouflages, the same labels for every vehicle, made on
``LIBRARY/<vehicle>/data``, in other places than those below. ``--shipped`` are some of earlier batteries. A battery
that is released is never written again: the next one gets another name.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rauca_core.contract import Camouflage, Dataset, Plan, Quality, RaucaError, Ring, load_camouflage, save_camouflage
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
    "street-seen": (STREET, SEEN, TEST["batteries, street-seen"], {"quick": 5, "standard": 48, "overnight": 192}),
    "street-unseen": (STREET, UNSEEN, TEST["batteries, street-unseen"], {"quick": 5, "standard": 48, "overnight": 192}),
    "high": (HIGH, (*SEEN, *UNSEEN), TEST["batteries, high"], {"quick": 4, "standard": 32, "overnight": 128}),
}


def views_plan(ring: Ring, weathers: tuple, seed: int, light: bool) -> Plan:
    """Frames of 320 pixels; fog is composed where it is only optimized on, and rendered where it is judged."""
    return Plan.of(
        weathers, ring, name="battery", size=320, quality=Quality(8, composed_fog=light), light=light, locations=8,
        seed=seed,
    )  # fmt: skip


def keep(folder: Path, vehicle: str) -> None:
    """Copy a new camouflage into the library."""
    record, image = load_camouflage(folder / "camouflage.json")
    path = library_folder() / vehicle / f"{folder.name}.json"
    save_camouflage(path, replace(record, name=folder.name), image.read_bytes())


def against(record: Camouflage) -> list[str]:
    """The detectors that a camouflage was optimized against."""
    names: list[str] = record.made["detector"].split("+")
    return names


def shipped(vehicle: str, label: str) -> tuple[Camouflage, Path]:
    """A camouflage of the library, and its UV map."""
    return load_camouflage(library_folder() / vehicle / f"{label}.json")


def fingerprints(label: str) -> tuple[str, ...]:
    """Of the detectors that a camouflage of the library was optimized against."""
    record, _ = shipped(VEHICLES[0], label)
    return tuple(load_detector(name).fingerprint for name in against(record))


def card_row(folder: Path) -> str:
    """What is known of a new camouflage, as a row of a Markdown table."""
    record, _ = load_camouflage(folder / "camouflage.json")
    licences = ", ".join(dict.fromkeys(SOURCES[name].licence for name in against(record)))
    views = len(Dataset(folder.parent / "data").frames())
    told = (record.method, ", ".join(against(record)), licences, record.made["steps"], views)
    return f"| {folder.parent.name} | {folder.name} | {' | '.join(map(str, told))} |"


def add_to_card(folders: Sequence[Path]) -> None:
    """New rows of the page beside the camouflages, which says what each is."""
    town = TRAINING["library of the batteries"]
    for folder in folders:
        if Dataset(folder.parent / "data").plan.seed != town:
            raise RaucaError(f"{folder.parent / 'data'}: make it with --seed {town}, the library's town")
    path = library_folder() / "README.md"
    lines = path.read_text().splitlines()
    table = next(k for k, line in enumerate(lines) if line.startswith("|---")) + 1
    rows = sorted({*lines[table:], *map(card_row, folders)})
    write_bytes(path, "\n".join([*lines[:table], *rows, ""]).encode())


def main() -> None:
    """Write the battery; refuse to change one that is there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name")
    parser.add_argument("library", type=Path)
    parser.add_argument("--shipped", action="append", default=[])
    given = parser.parse_args()
    path = assets_folder() / "batteries" / f"{given.name}.json"
    if path.exists():
        raise RaucaError(f"{path}: a battery never changes; choose another name")
    new = sorted(one.parent.name for one in (given.library / VEHICLES[0]).glob("*/camouflage.json"))
    folders = [given.library / vehicle / label for vehicle in VEHICLES for label in new]
    add_to_card(folders)
    for folder in folders:
        keep(folder, folder.parent.name)
    labels = sorted([*new, *given.shipped])
    vehicles = []
    for choice in find_vehicles(VEHICLES):
        maps = {label: file_digest(shipped(choice.name, label)[1]) for label in labels}
        vehicles.append(BatteryVehicle(choice.name, recipes.vehicle_in(choice.folder).settings["content"], maps))
    battery = Battery(
        name=given.name,
        category="car",
        vehicles=tuple(vehicles),
        made_against={label: fingerprints(label) for label in labels},
        random=RandomPaint(),
        attack=views_plan(ATTACK, SEEN, TRAINING["attacks of the batteries"], light=True),
        views=tuple(
            BatteryViews(name, views_plan(ring, weathers, seed, light=False), frames)
            for name, (ring, weathers, seed, frames) in VIEWS.items()
        ),
    )
    write_json(path, battery.to_json())


if __name__ == "__main__":
    main()
