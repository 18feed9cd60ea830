"""Make the shipped vehicles again: ``python -m rauca_core.geometry.build NAME|all [FOLDER]``."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

from ..contract import RaucaError
from ..contract.assets import assets_folder
from .aeroplane import AEROPLANES, build_aeroplane
from .boat import BOATS, build_boat
from .car import CARS, build_car
from .shapes import SHAPES, build_shape

BUILDERS = {
    name: partial(build, name)
    for names, build in (
        (CARS, build_car),
        (SHAPES, build_shape),
        (BOATS, build_boat),
        (AEROPLANES, build_aeroplane),
    )
    for name in names
}


def main(arguments: list[str]) -> int:
    """Build one vehicle or all into the assets folder, or below a folder given last; returns the exit code."""
    if not 1 <= len(arguments) <= 2 or arguments[0] not in (*BUILDERS, "all"):
        names = ",".join((*BUILDERS, "all"))
        print(f"usage: python -m rauca_core.geometry.build {{{names}}} [FOLDER]", file=sys.stderr)
        return 2
    chosen = list(BUILDERS) if arguments[0] == "all" else arguments[:1]
    try:
        folder = Path(arguments[1]) if len(arguments) == 2 else assets_folder() / "vehicles"
        for name in chosen:
            vehicle = BUILDERS[name]()
            vehicle.save(folder / name)
            length, width, height = vehicle.size()
            faces = len(vehicle.triangles)
            print(f"{folder / name}: {faces} triangles, {length:.2f} x {width:.2f} x {height:.2f} m")
    except RaucaError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
