"""Turning a vehicle into its own frame: front +x, up +z, wheels on z = 0, metres."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core import contract
from .vehicle_arrays import Soup
from .vehicle_request import VehicleRequest

LENGTH_M = (0.5, 50.0)
Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
TURNS = {  # from the axis of the front to +x
    "+X": np.eye(3),
    "-X": np.diag([-1.0, -1, 1]),
    "+Y": np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
    "-Y": np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]),
}


def orient(soup: Soup, request: VehicleRequest) -> tuple[NDArray[np.float64], list[str]]:
    """Turn and move the vehicle in place.

    Returns:
        The transform that was applied, (4, 4), and what was assumed.

    Raises:
        RaucaError: a length that no vehicle has.
    """
    turn, notes = np.eye(3), []
    size = np.ptp(soup.positions, axis=0)
    if request.guess_up and size[1] < size[2]:
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
    origin = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    soup.positions -= origin
    length, width, height = high - low
    if not LENGTH_M[0] <= length <= LENGTH_M[1]:
        raise contract.RaucaError(
            f"{request.where}: is {length:.4g} long, metres are expected; scale it by about"
            f" {4.5 / max(length, 1e-9):.1g}"
        )
    notes.append(f"size: {length:.2f} x {width:.2f} x {height:.2f} m (length, width, height)")
    applied = np.eye(4)
    applied[:3, :3], applied[:3, 3] = turn, -origin
    return applied, notes
