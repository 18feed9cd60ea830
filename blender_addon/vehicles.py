"""The vehicle a user names: one that is shipped, or any vehicle file."""

from __future__ import annotations

from pathlib import Path

from .core import contract
from .scene.vehicle import load_shipped, shipped_names


def find_vehicle(source: contract.VehicleSource) -> contract.Vehicle:
    """A shipped vehicle by name, or any vehicle file, or the folder of one that was saved.

    Raises:
        RaucaError: there is none of that name, the file cannot be used, or a shipped one is given a paint option.
    """
    known = shipped_names()
    if source.name in known:
        if source.paint_mask or source.paint_material:
            raise contract.RaucaError(f"--vehicle {source.name} brings its own paint; drop the paint option")
        return load_shipped(source.name)
    path = Path(source.name)
    if not path.exists():
        raise contract.RaucaError(
            f"{path}: no such vehicle; give an .obj, .glb or .blend file, or one of {', '.join(known)}"
        )
    from .scene.vehicle_files import import_vehicle

    return import_vehicle(path, source.paint_mask, source.paint_material)
