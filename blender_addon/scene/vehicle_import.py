"""Any vehicle file into the contract's vehicle."""

from __future__ import annotations

from pathlib import Path

from ..core import contract
from .images import read_image_blender
from .vehicle_files import opened
from .vehicle_reading import read_vehicle
from .vehicle_request import VehicleRequest


def import_vehicle(path: Path, paint_mask: Path | None = None, paint_material: str | None = None) -> contract.Vehicle:
    """Read a vehicle from an .obj, .glb, .gltf or .blend file, or from a rauca vehicle folder.

    The session's own data is left as it was. What was assumed about axes, paint and UVs is told in ``notes``.

    Args:
        paint_mask: grey PNG in the vehicle's own UVs, white where the camouflage may go.
        paint_material: name of the material to camouflage.

    Raises:
        RaucaError: a missing or damaged file, no faces, NaN vertices, implausible size, or no telling what is paint.
    """
    path = Path(path)
    if path.is_dir():
        if paint_mask or paint_material:
            raise contract.RaucaError(f"{path}: a vehicle folder brings its own paint; drop the paint option")
        return contract.load_vehicle(path, read_image_blender)
    with opened(path) as objects:
        return read_vehicle(objects, VehicleRequest.of_file(path, paint_mask, paint_material))
