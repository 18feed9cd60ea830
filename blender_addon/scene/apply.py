"""A vehicle in camouflage in any scene: for looking at it, and for carrying it elsewhere."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..core import contract
from .camouflages import read_paintwork
from .vehicle import SceneVehicle


def apply_camouflage(scene: bpy.types.Scene, vehicle: contract.Vehicle, camouflage: Path) -> SceneVehicle:
    """Add ``vehicle`` to ``scene``, painted with ``camouflage`` (.json).

    Raises:
        RaucaError: the camouflage is damaged or was made for another UV atlas; the scene is left as it was.
    """
    paintwork = read_paintwork(camouflage, vehicle.atlas_id)
    placed = SceneVehicle(scene, vehicle)
    placed.paint.set_map(paintwork.uv_map_srgb)
    placed.paint.pack()
    placed.object.name = f"{vehicle.name} {paintwork.name}"
    return placed


def save_blend(vehicle: contract.Vehicle, camouflage: Path, out: Path) -> None:
    """Write a .blend that holds nothing but the vehicle in camouflage, images packed."""
    scene = bpy.data.scenes.new("rauca")
    placed = apply_camouflage(scene, vehicle, camouflage)
    out.parent.mkdir(parents=True, exist_ok=True)
    bpy.data.libraries.write(str(out), {scene, placed.object}, fake_user=True, compress=True)
