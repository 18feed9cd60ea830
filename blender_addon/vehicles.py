"""The vehicle a user names: one that is shipped, or any vehicle file."""

from __future__ import annotations

from pathlib import Path

from .core import contract
from .scene.shipped import load_shipped, shipped_names


def find_vehicle(name_or_path: str, paint_mask: Path | None, paint_material: str | None) -> contract.Vehicle:
    """A shipped vehicle by name, or any vehicle file, or the folder of one that was saved.

    Raises:
        RaucaError: there is none of that name, the file cannot be used, or a shipped one is given a paint option.
    """
    known = shipped_names()
    if name_or_path in known:
        if paint_mask or paint_material:
            raise contract.RaucaError(f"--vehicle {name_or_path} brings its own paint; drop the paint option")
        return load_shipped(name_or_path)
    path = Path(name_or_path)
    if not path.exists():
        raise contract.RaucaError(
            f"{path}: no such vehicle; give an .obj, .glb or .blend file, or one of {', '.join(known)}"
        )
    from .scene.vehicle_import import import_vehicle

    return import_vehicle(path, paint_mask, paint_material)
