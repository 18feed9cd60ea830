"""What is read from disk with Pillow: vehicles, a finished frame's images, what a detector should find in them."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import contract
from ..contract import Box, Dataset, Frame, ImportVehicle, RaucaError, Vehicle, VehicleSource, load_passes
from ..contract.assets import shipped_vehicles
from ..contract.semantics import MIN_BOX_PIXELS
from ..runtime.blender import run_blender
from ..runtime.images import read_image

FILES = (".obj", ".glb", ".blend")  # of vehicles, which Blender reads
GREY = ("vehicle.png", "paint.png", "semantic.png", "instances.png")


def load_vehicle(
    vehicle: Path | str,
    paint_mask: Path | None = None,
    paint_material: str | None = None,
    blender: Path | None = None,
) -> Vehicle:
    """A shipped vehicle by its name, one in a folder, such as a data set's ``vehicle/``, or one that Blender reads.

    Args:
        vehicle: name, folder, or an .obj, .glb or .blend.
        paint_mask: grey PNG, white where the camouflage may go; of a file only.
        paint_material: name of the material to camouflage; of a file only.
        blender: program that reads the file; the bpy wheel if left out.

    Raises:
        RaucaError: no such vehicle, its files are damaged, or Blender is missing.
    """
    if Path(vehicle).is_file() and Path(vehicle).suffix.lower() in FILES:
        with tempfile.TemporaryDirectory(prefix="rauca-") as scratch:
            source = VehicleSource(str(vehicle), paint_mask, paint_material)
            run_blender(ImportVehicle(Path(scratch), source), lambda progress: None, blender)
            return contract.load_vehicle(Path(scratch), read_image)
    if paint_mask or paint_material:
        raise RaucaError(f"{vehicle}: --paint-mask and --paint-material are of an .obj, .glb or .blend file; drop them")
    shipped = shipped_vehicles()
    folder = shipped.get(str(vehicle), Path(vehicle))
    if not (folder / "vehicle.json").is_file():
        raise RaucaError(
            f"{vehicle}: neither a vehicle folder, nor an .obj, .glb or .blend, nor one of {', '.join(shipped)}; look "
            "at its path"
        )
    return contract.load_vehicle(folder, read_image)


@dataclass(frozen=True, eq=False)
class StoredFrame:
    """One frame of a data set; images are read when asked for.

    Attributes:
        folder: of the frame.
        frame: its ``frame.json``.
    """

    folder: Path
    frame: Frame

    @staticmethod
    def all_of(dataset: Dataset, purpose: str = "look at") -> list[StoredFrame]:
        """The finished frames, in plan order; raises :class:`RaucaError` where there is none to do something with."""
        found = [StoredFrame(dataset.frame_folder(frame.id), frame) for frame in dataset.frames()]
        if not found:
            raise RaucaError(f"{dataset.folder}: no finished frame to {purpose}; make the data set first")
        return found

    def image(self, name: str = "image.png") -> NDArray[np.uint8]:
        """A PNG of the frame: (H, W) for coverage and ids, (H, W, 3) sRGB for pictures."""
        return read_image(self.folder / name)

    def maps(self, *names: str) -> dict[str, NDArray[Any]]:
        """Arrays of ``passes.npz``."""
        return load_passes(self.folder, names)


COCO_VEHICLES = ("person", "bicycle", "car", "motorcycle", "airplane", "bus", "train", "truck", "boat")
"""COCO's first classes; its annotation files count them from 1, YOLO's networks from 0."""

FIRST_OWN_COCO_ID = 91  # COCO's own end at 90


@dataclass(frozen=True, eq=False)
class Target:
    """One thing to detect: its class, tight box in pixels, and the (H, W) mask of what is visible of it.

    Pixels at least half covered by the data set's vehicle are its own.
    """

    category: str
    box_xyxy: Box
    mask: NDArray[np.bool_]


def targets_of(stored: StoredFrame, category: str) -> Iterator[Target]:
    """The data set's vehicle first, then others by id; those of fewer than 16 visible pixels are left out."""
    frame = stored.frame
    if frame.box_xyxy is not None:
        yield Target(category, frame.box_xyxy, stored.image("vehicle.png") >= 128)
    for instance in frame.instances:
        if instance.pixels >= MIN_BOX_PIXELS:
            yield Target(instance.category, instance.box_xyxy, stored.image("instances.png") == instance.id)


def categories_of(frames: list[StoredFrame], category: str) -> list[str]:
    """All classes of a data set: COCO's in COCO's order, then those that COCO lacks."""
    seen = {category} | {instance.category for stored in frames for instance in stored.frame.instances}
    return [*COCO_VEHICLES, *sorted(seen - set(COCO_VEHICLES))]


def coco_id(categories: list[str], name: str) -> int:
    """COCO's id of a class; classes that COCO lacks are counted from 91."""
    place, known = categories.index(name), len(COCO_VEHICLES)
    return place + 1 if place < known else FIRST_OWN_COCO_ID + place - known
