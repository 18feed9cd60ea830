"""Frozen batteries: the same views and paints for every detector, so that results compare between machines and years.

A battery is a file, ``assets/batteries/<name>.json``, and never changes once it is released; a better one gets the next
number. Its places were never chosen, trained or optimized on, and its camouflages were made in another town::

    {"format": "rauca-battery", "version": 1, "name": "assess-1", "category": "car",
     "vehicles": [{"name": "sedan", "content": "<digest>", "camouflages": {"ours-ssd": "<sha256 of the UV map>"}}, ...],
     "random": {"seed": 1, "cell": 8, "size": 1024},
     "views": [{"name": "street-seen", "plan": {...}, "frames": {"quick": 8, "standard": 32, "overnight": 128}}, ...]}
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from ..contract import Plan, RaucaError, balanced_frames, load_camouflage
from ..contract.assets import assets_folder
from ..contract.files import file_digest
from ..contract.schema import Record, read_json
from . import recipes
from .artifact import Artifact
from .candidates import VehicleChoice, find_vehicles

LATEST = "assess-1"
BUDGETS = ("quick", "standard", "overnight")


@dataclass(frozen=True)
class BatteryVehicle(Record):
    """A shipped vehicle.

    Attributes:
        content: digest of all that a render shows of it.
        camouflages: sha256 of each UV map of the library, by label.
    """

    name: Annotated[str, "plain_name"]
    content: str
    camouflages: dict[str, str]


@dataclass(frozen=True)
class RandomPaint(Record):
    """The random baseline: seed, side of a cell and side of the map in texels."""

    seed: int = 1
    cell: int = 8
    size: int = 1024


@dataclass(frozen=True)
class BatteryViews(Record):
    """Held-out views of every vehicle.

    Attributes:
        plan: of all views; vehicle and atlas are those of each vehicle in turn.
        frames: how many are rendered per vehicle, by budget; more of them contain the fewer.
    """

    name: Annotated[str, "plain_name"]
    plan: Plan
    frames: dict[str, int]


@dataclass(frozen=True)
class Battery(Record):
    """What every detector is shown; see this module."""

    FORMAT = ("rauca-battery", 1)

    name: str
    category: str
    vehicles: tuple[BatteryVehicle, ...]
    random: RandomPaint
    views: tuple[BatteryViews, ...]

    def _check_whole(self, where: str) -> None:
        if not self.vehicles or not self.views or any(set(v.frames) != set(BUDGETS) for v in self.views):
            raise RaucaError(f"{where}: needs vehicles, and views with frames for {', '.join(BUDGETS)}")

    def choices(self) -> dict[BatteryVehicle, VehicleChoice]:
        """The shipped vehicles, checked to be those that the battery was made for.

        Raises:
            RaucaError: one has changed since.
        """
        found = {}
        for vehicle in self.vehicles:
            (choice,) = find_vehicles([vehicle.name])
            if recipes.vehicle_in(choice.folder).settings["content"] != vehicle.content:
                raise RaucaError(
                    f"{choice.folder}: is another vehicle than the one {self.name} was made for, so its results would "
                    "not compare; take the rauca that this folder came with, or a newer battery"
                )
            found[vehicle] = choice
        return found

    def views_of(self, choice: VehicleChoice, budget: str) -> dict[str, Artifact]:
        """The views of a vehicle to be rendered, by name."""
        body = recipes.vehicle_in(choice.folder)
        found = {}
        for views in self.views:
            plan = replace(views.plan, vehicle_name=choice.name, atlas_id=choice.atlas_id)
            frames = balanced_frames(plan, views.frames[budget])
            found[views.name] = recipes.data_set(f"{self.name}-{choice.name}-{views.name}", plan, body, frames)
        return found

    def camouflages_of(self, vehicle: BatteryVehicle) -> Mapping[str, Path]:
        """The library's camouflages of a vehicle (JSON), by label.

        Raises:
            RaucaError: one is missing, or is not the one that the battery was made with.
        """
        found = {}
        for label, sha256 in vehicle.camouflages.items():
            path = library_folder() / vehicle.name / f"{label}.json"
            _, image = load_camouflage(path)
            if file_digest(image) != sha256:
                raise RaucaError(f"{image}: is not the map that {self.name} was made with; install rauca again")
            found[label] = path
        return found


def library_folder() -> Path:
    """Where the shipped camouflages lie, a folder per vehicle."""
    return assets_folder() / "camouflages"


def load_battery(name: str = LATEST) -> Battery:
    """A shipped battery by name; raises :class:`RaucaError` listing all when there is none of that name."""
    folder = assets_folder() / "batteries"
    path = folder / f"{name}.json"
    if not path.is_file():
        known = ", ".join(sorted(one.stem for one in folder.glob("*.json")))
        raise RaucaError(f"--battery {name}: unknown; choose {known}")
    return Battery.from_json(read_json(path))
