"""Which camouflages take part in a study, and on which vehicles; mistakes are found before anything is rendered."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..contract import Camouflage, RaucaError, load_camouflage, save_camouflage
from ..contract.assets import shipped_vehicles
from ..contract.schema import read_json
from ..contract.vehicle import target_class
from ..runtime.images import read_image

NORMAL = "normal"  # the vehicle in its reference paint
RANDOM = "random"  # random paint made for the study
REMEDY = "give its vehicle folder as --vehicle, such as `vehicle` in the data set it was optimized on"
_LABEL = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+ -]*")  # it names folders and table rows


@dataclass(frozen=True)
class Candidate:
    """A camouflage under the label it has in tables; ``path`` is its JSON."""

    label: str
    path: Path
    record: Camouflage


@dataclass(frozen=True)
class VehicleChoice:
    """A vehicle that a study is about; ``category`` is the class that detectors are asked for."""

    name: str
    category: str
    atlas_id: str
    folder: Path

    @property
    def target(self) -> str:
        """The class that a camouflage hides it from."""
        return target_class(self.category)


def read_candidates(given: Iterable[str], reserved: Iterable[str] = (NORMAL,)) -> list[Candidate]:
    """Read camouflages given as ``FILE`` or ``LABEL=FILE`` (JSON or PNG path).

    Raises:
        RaucaError: a missing or damaged file, a map of another size than its JSON says, a label that is reserved or
            cannot name a folder, two of one label on the same vehicle.
    """
    candidates = [_read(one) for one in given]
    seen: dict[tuple[str, str], Candidate] = {}
    for candidate in candidates:
        label, path = candidate.label, candidate.path
        if label.lower() in set(reserved) or not _LABEL.fullmatch(label):
            raise RaucaError(f"{path}: cannot be called {label!r} in a study; name it: LABEL={path}")
        twin = seen.setdefault((candidate.record.atlas_id, label), candidate)
        if twin is not candidate:
            raise RaucaError(f"{path}: called {label!r} as {twin.path} is; name one: LABEL={path}")
    return candidates


def _read(given: str) -> Candidate:
    label, equals, path = given.partition("=")
    if not equals or Path(given).exists():
        label, path = "", given
    record, image = load_camouflage(Path(path))
    height, width = read_image(image).shape[:2]
    if (height, width) != (record.size, record.size):
        raise RaucaError(
            f"{image}: is {width}x{height}, its .json says {record.size}x{record.size}; keep the two files together"
        )
    return Candidate(label or record.name, Path(path).with_suffix(".json"), record)


def find_vehicles(names: Sequence[str]) -> list[VehicleChoice]:
    """Vehicles by shipped name or vehicle folder; every shipped one when ``names`` is empty.

    Raises:
        RaucaError: neither a shipped vehicle nor a vehicle folder.
    """
    shipped, vehicles = shipped_vehicles(), []
    for name in names or shipped:
        folder = shipped.get(name, Path(name))
        if not (folder / "vehicle.json").is_file():
            raise RaucaError(
                f"--vehicle {name}: no vehicle folder; give one, such as the `vehicle` folder of the data set that the "
                f"camouflage was optimized on, or one of {', '.join(shipped)}"
            )
        vehicles.append(read_vehicle_choice(folder))
    return vehicles


def read_vehicle_choice(folder: Path) -> VehicleChoice:
    """What a vehicle folder says of itself."""
    fields = read_json(folder / "vehicle.json")
    return VehicleChoice(fields.plain_name("name"), fields.text("category"), fields.text("atlas_id"), folder)


def match(
    candidates: Sequence[Candidate], vehicles: Sequence[VehicleChoice], everyone: bool, remedy: str = REMEDY
) -> Mapping[VehicleChoice, list[Candidate]]:
    """Which camouflages each vehicle is evaluated in.

    Args:
        everyone: evaluate vehicles that no camouflage fits, too (in their other paints).
        remedy: for a camouflage that fits none.

    Raises:
        RaucaError: a camouflage that fits none of the vehicles, two vehicles of one name.
    """
    by_atlas = {vehicle.atlas_id: vehicle for vehicle in vehicles}
    matched: dict[VehicleChoice, list[Candidate]] = {vehicle: [] for vehicle in vehicles}
    for candidate in candidates:
        record = candidate.record
        if record.atlas_id not in by_atlas:
            known = ", ".join(f"{v.name} ({v.atlas_id})" for v in vehicles)
            raise RaucaError(
                f"{candidate.path}: made for UV atlas {record.atlas_id} of {record.vehicle_name}, there are {known}; "
                f"{remedy}"
            )
        matched[by_atlas[record.atlas_id]].append(candidate)
    result = {vehicle: some for vehicle, some in matched.items() if some or everyone}
    names = [vehicle.name for vehicle in result]
    if twice := {name for name in names if names.count(name) > 1}:
        raise RaucaError(f"--vehicle: two different vehicles are called {min(twice)!r}; evaluate them in two studies")
    return result


def keep_copy(label: str, path: Path, folder: Path) -> Path:
    """Copy a camouflage to ``folder/<label>.json`` under a label, so that a study holds what it judged."""
    target = folder / f"{label}.json"
    record, image = load_camouflage(path)
    record, png = replace(record, name=label), image.read_bytes()
    with contextlib.suppress(RaucaError):
        found, kept = load_camouflage(target)
        if found == record and kept.read_bytes() == png:
            return target
    save_camouflage(target, record, png)
    return target
