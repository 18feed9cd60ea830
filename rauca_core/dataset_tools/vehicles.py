"""Vehicles by name or by folder."""

from __future__ import annotations

from pathlib import Path

from .. import contract
from ..contract import RaucaError, Vehicle
from ..contract.assets import assets_folder
from ..runtime.images import read_image


def load_vehicle(vehicle: Path | str) -> Vehicle:
    """A shipped vehicle by its name, or one in a folder, such as a data set's ``vehicle/``.

    Raises:
        RaucaError: no such vehicle, or its files are damaged. An .obj, .glb or .blend has to be read by Blender first:
            `make_dataset` takes it, and leaves its folder in the data set.
    """
    shipped = assets_folder() / "vehicles"
    names = sorted(path.parent.name for path in shipped.glob("*/vehicle.json"))
    if str(vehicle) in names:
        return contract.load_vehicle(shipped / str(vehicle), read_image)
    folder = Path(vehicle)
    if not (folder / "vehicle.json").is_file():
        raise RaucaError(
            f"{vehicle}: neither a vehicle folder nor one of {', '.join(names)}; an .obj, .glb or .blend is read by "
            "`rauca dataset make --vehicle FILE`, which leaves its folder in the data set"
        )
    return contract.load_vehicle(folder, read_image)
