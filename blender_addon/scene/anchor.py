"""Where a vehicle of the artist's scene stands, found quickly enough for drawing: its frame and its middle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from .orient import TURNS
from .shipped import NAME_KEY
from .vehicle_arrays import SHAPES
from .vehicle_request import VehicleRequest

HALF_HEIGHT_M = 0.75  # of the middle of no vehicle in particular


@dataclass(frozen=True, eq=False)
class Anchor:
    """What the cameras stand around.

    Attributes:
        vehicle_to_world: (4, 4) rigid transform; front along +x, wheels on z = 0.
        center: (3,) the middle of the vehicle's box, in its frame, metres.
        found: False when there is no vehicle in the scene and the world's origin stands in for it.
    """

    vehicle_to_world: NDArray[np.float64]
    center: NDArray[np.float64]
    found: bool = True


NOWHERE = Anchor(np.eye(4), np.array([0.0, 0.0, HALF_HEIGHT_M]), found=False)


def find_anchor(objects: Sequence[bpy.types.Object], request: VehicleRequest) -> Anchor:
    """The anchor of a vehicle made of ``objects``, which renders show, as `orient.py` and `shipped.py` place it."""
    shaped = [thing for thing in objects if thing.type in SHAPES]
    if not shaped:
        return NOWHERE
    meshes = [thing for thing in shaped if thing.type == "MESH"]
    if len(meshes) == 1 and NAME_KEY in meshes[0] and not request.own_paint and not meshes[0].modifiers:
        local = _vertices(meshes[0])
        matrix = np.array(meshes[0].matrix_world)
        if len(local) and np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-4):
            return Anchor(matrix, (local.min(axis=0) + local.max(axis=0)) / 2)
    placed = [
        _vertices(thing) @ np.array(thing.matrix_world)[:3, :3].T + thing.matrix_world.translation for thing in shaped
    ]
    points = np.concatenate(placed)
    if not len(points):
        return NOWHERE
    low, high = points.min(axis=0), points.max(axis=0)
    length, width, height = high - low
    front = request.front
    if front == "AUTO":
        front = "-Y" if width > length else "+X"
    pose = np.eye(4)
    pose[:3, :3] = TURNS[front].T
    pose[:3, 3] = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2])
    return Anchor(pose, np.array([0.0, 0.0, height / 2]))


def _vertices(thing: bpy.types.Object) -> NDArray[np.float64]:
    """Vertices of an object's evaluated mesh, (N, 3) in its own frame; the corners of its box for other shapes."""
    evaluated = thing.evaluated_get(bpy.context.view_layer.depsgraph)
    if thing.type != "MESH" or thing.mode == "EDIT":
        return np.array(evaluated.bound_box, float).reshape(-1, 3)
    vertices = evaluated.data.vertices
    flat = np.empty(3 * len(vertices), np.float32)
    vertices.foreach_get("co", flat)
    return flat.reshape(-1, 3).astype(np.float64)
