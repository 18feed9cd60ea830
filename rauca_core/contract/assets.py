"""Where the project's own data lies: procedural vehicles, weather presets, network descriptions."""

from __future__ import annotations

from pathlib import Path

from .errors import RaucaError


def assets_folder() -> Path:
    """The assets folder of a checkout, an installed wheel or the Blender extension, whichever this code is part of."""
    package = Path(__file__).resolve().parent.parent
    for base in (package, package.parent):
        if (base / "assets" / "weathers").is_dir():
            return base / "assets"
    raise RaucaError(f"{package}: the assets folder is missing; install rauca again")


def shipped_vehicles() -> dict[str, Path]:
    """The folders of the procedural vehicles by their names, in order."""
    return {path.parent.name: path.parent for path in sorted((assets_folder() / "vehicles").glob("*/vehicle.json"))}
