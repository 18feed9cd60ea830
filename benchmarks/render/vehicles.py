"""The vehicles that are measured: a shipped one, a vehicle folder, or a file that Blender imports."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from rauca_core.contract import RaucaError, Vehicle, load_vehicle
from rauca_core.contract.assets import assets_folder
from rauca_core.runtime.blender import require_bpy
from rauca_core.runtime.images import read_image

SCRIPT = Path(__file__).with_name("import_vehicle.py")


def open_vehicle(name_or_path: str, paint_mask: Path | None = None, paint_material: str | None = None) -> Vehicle:
    """Find a vehicle; .obj, .glb and .blend files are imported by Blender in a process of its own.

    Raises:
        RaucaError: no such vehicle, nothing paintable, paint chosen for one that brings its own, or Blender is missing.
    """
    for folder in (assets_folder() / "vehicles" / name_or_path, Path(name_or_path)):
        if (folder / "vehicle.json").is_file():
            if paint_mask or paint_material:
                raise RaucaError(f"--vehicle {name_or_path} brings its own paint; drop the paint option")
            return load_vehicle(folder, read_image)
    require_bpy("give a vehicle folder")
    with tempfile.TemporaryDirectory(prefix="rauca-bench-") as temporary:
        folder = Path(temporary) / "vehicle"
        arguments = [name_or_path, str(paint_mask or ""), paint_material or "", str(folder)]
        done = subprocess.run([sys.executable, "-P", str(SCRIPT), *arguments], capture_output=True, text=True)
        if done.returncode:
            lines = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
            raise RaucaError(
                lines[-1].removeprefix("error: ") if lines else f"{name_or_path}: Blender cannot import it"
            )
        return load_vehicle(folder, read_image)


def painted_all_over(vehicle: Vehicle) -> Vehicle | None:
    """The vehicle with every face painted, as the published renderer textures it; None without an atlas for that."""
    a, b, c = vehicle.uvs.astype(np.float64).transpose(1, 0, 2)
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    unwrapped = np.abs(ux * vy - uy * vx) > 0
    if unwrapped.mean() < 0.9:
        return None
    materials = [replace(material, kind="paint") for material in vehicle.materials]
    return replace(vehicle, materials=materials, paint_mask=np.full_like(vehicle.paint_mask, 255))
