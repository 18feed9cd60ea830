"""What is asked for when a vehicle is made from objects: names for messages, and which faces are paint."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Front = Literal["AUTO", "+X", "-X", "+Y", "-Y"]
OPTIONS_REMEDY = "give --paint-mask PNG or --paint-material NAME, or mark the faces in Blender"


@dataclass(frozen=True)
class VehicleRequest:
    """How objects become a vehicle.

    Attributes:
        where: names the vehicle in messages: its file or its object.
        name: the vehicle's name.
        source: the file it comes from, for the record.
        beside: an image that stands in for a missing base texture.
        guess_up: the file may mean y as up.
        front: the axis along which the vehicle's front points; ``AUTO`` takes the longer side.
        paint_mask: grey PNG in the vehicle's own UVs, white where the camouflage may go.
        paint_material: name of the material to camouflage.
        by_marks: paint is what is marked by hand; None: if anything is.
        remedy: how the user can say what is paint.
    """

    where: str
    name: str
    source: str = ""
    beside: Path | None = None
    guess_up: bool = False
    front: Front = "AUTO"
    paint_mask: Path | None = None
    paint_material: str | None = None
    by_marks: bool | None = None
    remedy: str = OPTIONS_REMEDY

    @property
    def own_paint(self) -> bool:
        """True when the user says what is paint; else the vehicle does."""
        return self.paint_material is not None or self.paint_mask is not None or bool(self.by_marks)

    @staticmethod
    def of_file(path: Path, paint_mask: Path | None, paint_material: str | None) -> VehicleRequest:
        """For a file's objects; an OBJ knows neither its up axis nor, often, its texture."""
        obj = path.suffix.lower() == ".obj"
        beside = path.with_suffix(".png") if obj else None
        return VehicleRequest(
            str(path), path.stem, path.name, beside, obj, paint_mask=paint_mask, paint_material=paint_material
        )
