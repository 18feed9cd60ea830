"""Points of a vehicle that somebody has marked in a picture: a JSON file.

::

    {"format": "rauca-points", "version": 1,
     "points": [{"name": "left headlamp", "vehicle_m": [2.1, 0.7, 0.6], "pixel": [311.5, 402.0]}, ...]}
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ..contract import RaucaError
from ..contract.schema import Record, read_json

FEWEST = 6
"""A pinhole camera of unknown focal length has seven unknowns: four points would do without noise, six bear it."""


@dataclass(frozen=True, eq=False)
class MarkedPoint(Record):
    """One point.

    Attributes:
        name: for people.
        vehicle_m: (3,) metres in the vehicle's own frame: front +x, left +y, up +z, wheels on z = 0.
        pixel: (2,) right and down; the center of the top-left pixel is (0.5, 0.5).
    """

    name: str
    vehicle_m: Annotated[NDArray[np.float64], (3,)]
    pixel: Annotated[NDArray[np.float64], (2,)]


@dataclass(frozen=True, eq=False)
class MarkedPoints(Record):
    """All points of one picture."""

    FORMAT = ("rauca-points", 1)
    points: tuple[MarkedPoint, ...]

    @property
    def vehicle_m(self) -> NDArray[np.float64]:
        """(N, 3) metres in the vehicle's own frame."""
        return np.stack([point.vehicle_m for point in self.points])

    @property
    def pixels(self) -> NDArray[np.float64]:
        """(N, 2) pixels of the picture."""
        return np.stack([point.pixel for point in self.points])

    def _check_whole(self, where: str) -> None:
        if len(self.points) < FEWEST:
            raise RaucaError(
                f"{where}: {len(self.points)} points; mark at least {FEWEST}, better eight, not in a plane"
            )
        spread = self.vehicle_m - self.vehicle_m.mean(0)
        if np.linalg.svd(spread, compute_uv=False)[2] < 0.01 * np.linalg.norm(spread):
            raise RaucaError(
                f"{where}: all points lie in one plane; mark some at another side or height of the vehicle"
            )


def read_points(path: Path) -> MarkedPoints:
    """Read a file of marked points; raises :class:`RaucaError` when it is missing, damaged or says too little."""
    return MarkedPoints.from_json(read_json(Path(path)))
