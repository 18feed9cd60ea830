"""Frozen batteries: the same views and paints for every detector, so that results compare between machines and years.

A battery is a file, ``assets/batteries/<name>.json``, and never changes once it is released; a better one gets the next
number. Its places were never chosen, trained or optimized on, and its camouflages were made in another town::

    {"format": "rauca-battery", "version": 1, "name": "assess-4", "category": "car",
     "vehicles": [{"name": "sedan", "content": "<digest>", "camouflages": {"zoomed-four": "<sha256 of its map>"}}, ...],
     "made_against": {"zoomed-four": ["<fingerprint of a detector>", ...], ...},
     "random": {"seed": 1, "cell": 8, "size": 1024},
     "attack": {...},
     "views": [{"name": "street-seen", "plan": {...}, "frames": {"quick": 8, "standard": 32, "overnight": 128}}, ...]}
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from .evaluate import RandomPaint

LATEST = "assess-4"
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
    """What every detector is shown; see this module.

    Attributes:
        category: the class that detectors are asked for.
        made_against: fingerprints of the detectors that each camouflage of the library was optimized against.
        attack: plan of the views with light maps that camouflages against the detector itself are optimized on, in a
            town that nobody is judged in.
    """

    FORMAT = ("rauca-battery", 1)

    name: str
    category: str
    vehicles: tuple[BatteryVehicle, ...]
    made_against: dict[str, tuple[str, ...]]
    random: RandomPaint
    attack: Plan
    views: tuple[BatteryViews, ...]

    def _check_whole(self, where: str) -> None:
        if not self.vehicles or not self.views or any(set(v.frames) != set(BUDGETS) for v in self.views):
            raise RaucaError(f"{where}: needs vehicles, and views with frames for {', '.join(BUDGETS)}")
        if any(set(vehicle.camouflages) != set(self.made_against) for vehicle in self.vehicles):
            raise RaucaError(f"{where}: every vehicle needs the same camouflages, those of made_against")

    def choices(self, names: Sequence[str] = ()) -> list[tuple[BatteryVehicle, VehicleChoice]]:
        """The shipped vehicles, or some of them, checked to be those that the battery was made for.

        Raises:
            RaucaError: one has changed since, or is not of this battery.
        """
        known = {vehicle.name: vehicle for vehicle in self.vehicles}
        if unknown := set(names) - set(known):
            raise RaucaError(f"--vehicle {min(unknown)}: not one of {self.name}; choose of {', '.join(known)}")
        found = []
        for vehicle in (known[name] for name in names or known):
            (choice,) = find_vehicles([vehicle.name])
            if recipes.vehicle_in(choice.folder).settings["content"] != vehicle.content:
                raise RaucaError(
                    f"{choice.folder}: is another vehicle than the one {self.name} was made for, so its results would "
                    "not compare; take the rauca that this folder came with, or a newer battery"
                )
            found.append((vehicle, choice))
        return found

    def views_of(self, choice: VehicleChoice, budget: str) -> dict[str, Artifact]:
        """The views of a vehicle to be rendered, by name."""
        return {views.name: self._views(choice, views.name, views.plan, views.frames[budget]) for views in self.views}

    def attack_views(self, choice: VehicleChoice, frames: int) -> Artifact:
        """Views of a vehicle to optimize on; as many as are asked for, and no others."""
        return self._views(choice, "attack", self.attack, frames, exact=True)

    def _views(self, choice: VehicleChoice, name: str, plan: Plan, frames: int, exact: bool = False) -> Artifact:
        worn = replace(plan, vehicle_name=choice.name, atlas_id=choice.atlas_id)
        label, body = f"{self.name}-{choice.name}-{name}", recipes.vehicle_in(choice.folder)
        return recipes.data_set(label, worn, body, balanced_frames(worn, frames), exact=exact)

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
    """A shipped battery by name, or one in a file; raises :class:`RaucaError` listing all when there is none."""
    folder = assets_folder() / "batteries"
    path = Path(name) if name.endswith(".json") else folder / f"{name}.json"
    if not path.is_file():
        known = ", ".join(sorted(one.stem for one in folder.glob("*.json")))
        raise RaucaError(f"--battery {name}: unknown; choose {known}")
    return Battery.from_json(read_json(path))
