"""What is asked for when a vehicle is made from objects, and turning them into its frame: front +x, up +z, metres."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from ..core import contract
from .vehicle_arrays import Soup

Front = Literal["AUTO", "+X", "-X", "+Y", "-Y"]


@dataclass(frozen=True)
class VehicleRequest:
    """How objects become a vehicle.

    Attributes:
        name: the vehicle's name.
        file: where the objects come from; None: the open scene.
        front: the axis along which the vehicle's front points; ``AUTO`` takes the longer side.
        paint_mask: grey PNG in the vehicle's own UVs, white where the camouflage may go.
        paint_material: name of the material to camouflage.
        by_marks: paint is what is marked by hand; None: if anything is.
    """

    name: str
    file: Path | None = None
    front: Front = "AUTO"
    paint_mask: Path | None = None
    paint_material: str | None = None
    by_marks: bool | None = None

    @property
    def own_paint(self) -> bool:
        """True when the user says what is paint; else the vehicle does."""
        return self.paint_material is not None or self.paint_mask is not None or bool(self.by_marks)

    @property
    def where(self) -> str:
        """Names the vehicle in messages."""
        return str(self.file or self.name)

    @property
    def remedy(self) -> str:
        """How the user can say what is paint."""
        if self.file is None:
            return "in step 1, Vehicle, choose the paint's material or mark its faces"
        return "give --paint-mask PNG or --paint-material NAME, or mark the faces in Blender"

    @property
    def is_obj(self) -> bool:
        """A file of a format that knows neither its up axis nor, often, its texture."""
        return self.file is not None and self.file.suffix.lower() == ".obj"

    @property
    def beside(self) -> Path | None:
        """An image that stands in for a missing base texture."""
        return self.file.with_suffix(".png") if self.file is not None and self.is_obj else None


LENGTH_M = (0.5, 50.0)
Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
TURNS = {  # from the axis of the front to +x
    "+X": np.eye(3),
    "-X": np.diag([-1.0, -1, 1]),
    "+Y": np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
    "-Y": np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]),
}


def orient(soup: Soup, request: VehicleRequest) -> list[str]:
    """Turn and move the vehicle in place; returns what was assumed.

    Raises:
        RaucaError: a length that no vehicle has.
    """
    turn, notes = np.eye(3), []
    size = np.ptp(soup.positions, axis=0)
    if request.is_obj and size[1] < size[2]:
        notes.append("axes: y taken as up, because the vehicle is smaller along y than along z")
        turn, size = Y_UP, size[[0, 2, 1]]
    else:
        notes.append("axes: z taken as up")
    if request.front != "AUTO":
        notes.append(f"axes: front at {request.front.lower()}, as chosen")
        turn = TURNS[request.front] @ turn
    elif size[1] > size[0]:
        notes.append("axes: turned by 90 degrees, because the vehicle is longer along y; its front is taken at -y")
        turn = TURNS["-Y"] @ turn
    soup.positions = soup.positions @ turn.T
    soup.normals = (soup.normals @ turn.T).astype(np.float32)
    low, high = soup.positions.min(axis=0), soup.positions.max(axis=0)
    soup.positions -= np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    length, width, height = high - low
    if not LENGTH_M[0] <= length <= LENGTH_M[1]:
        raise contract.RaucaError(
            f"{request.where}: is {length:.4g} long, metres are expected; scale it by about"
            f" {4.5 / max(length, 1e-9):.1g}"
        )
    notes.append(f"size: {length:.2f} x {width:.2f} x {height:.2f} m (length, width, height)")
    return notes
