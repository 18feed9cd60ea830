"""Runs in a process of its own, with Blender: import a vehicle file and save it as a vehicle folder.

Usage: python import_vehicle.py FILE PAINT_MASK PAINT_MATERIAL OUT; empty text where an option is not given.
"""

from __future__ import annotations

import sys
from pathlib import Path

from blender_addon.core import contract
from blender_addon.vehicles import find_vehicle

if __name__ == "__main__":
    name, mask, material, out = sys.argv[1:]
    try:
        find_vehicle(contract.VehicleSource(name, Path(mask) if mask else None, material or None)).save(Path(out))
    except contract.RaucaError as error:
        sys.exit(f"error: {error}")
