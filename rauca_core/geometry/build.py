"""Make the shipped vehicles again: ``python -m rauca_core.geometry.build sedan [FOLDER]``."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

from ..contract import RaucaError
from ..contract.assets import assets_folder
from .car import CARS, build_car
from .shapes import SHAPES, build_shape

BUILDERS = {name: partial(build_car, name) for name in CARS} | {name: partial(build_shape, name) for name in SHAPES}


def main(arguments: list[str]) -> int:
    """Build one vehicle into its assets folder, or into a folder given after its name; returns the exit code."""
    if not 1 <= len(arguments) <= 2 or arguments[0] not in BUILDERS:
        print(f"usage: python -m rauca_core.geometry.build {{{','.join(BUILDERS)}}} [FOLDER]", file=sys.stderr)
        return 2
    name = arguments[0]
    folder = Path(arguments[1]) if len(arguments) == 2 else assets_folder() / "vehicles" / name
    try:
        vehicle = BUILDERS[name]()
        vehicle.save(folder)
    except RaucaError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    length, width, height = vehicle.size()
    print(f"{folder}: {len(vehicle.triangles)} triangles, {length:.2f} x {width:.2f} x {height:.2f} m")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
