"""Plain solids of a vehicle's size: what an environment network learns light on before it sees its vehicle."""

from __future__ import annotations

import numpy as np

from ..contract import Vehicle
from .assemble import assemble
from .mesh import MeshParts
from .solids import turned_along_x

SHAPES = ("cylinder", "cube", "sphere")
EDGE_M = 3.0  # of the cube, and the sphere's diameter: a car's volume
CYLINDER_M = (4.0, 0.9)  # length and radius: it lies along x, so its side faces the sky, the street and the ground
SPHERE_CELLS = 16  # along each edge of the cube that the sphere is blown up from
SEGMENTS = 72


def build_shape(name: str) -> Vehicle:
    """Build and unwrap one of :data:`SHAPES`; deterministic."""
    parts = {"cylinder": _cylinder, "cube": _cube, "sphere": _sphere}[name]()
    whole = () if name == "sphere" else _PANELS  # half a side of the sphere flattens with little stretch, a whole not
    return assemble(name, "shape", parts, whole)


_SIDES = {  # of a cube: its outward axis and the two that span it, in counter-clockwise order
    "front": (0, 1, 2, 1),
    "rear": (0, 1, 2, -1),
    "left": (1, 2, 0, 1),
    "right": (1, 2, 0, -1),
    "top": (2, 0, 1, 1),
    "underside": (2, 0, 1, -1),
}
_PANELS = (*_SIDES, "side", "front cap", "rear cap")


def _cube() -> MeshParts:
    """Six squares; the one it stands on is bare."""
    parts = MeshParts()
    for panel in _SIDES:
        material = "bare" if panel == "underside" else f"paint/{panel}"
        parts.grid(_side(panel, 1) * EDGE_M / 2, material, flip=_SIDES[panel][3] < 0)
    return parts


def _sphere() -> MeshParts:
    """A cube blown up; equal angles between its lines keep the cells alike."""
    parts = MeshParts()
    for panel in _SIDES:
        points = np.tan(_side(panel, SPHERE_CELLS) * np.pi / 4)
        points /= np.linalg.norm(points, axis=-1, keepdims=True)
        middle = points[:-1, :-1] + points[1:, 1:]
        above = (middle[..., 2] > 0) & (_SIDES[panel][0] == 1)
        names = np.where(above, f"paint/{panel} above", f"paint/{panel}")
        parts.grid(points * EDGE_M / 2, names, flip=_SIDES[panel][3] < 0)
    return parts


def _side(panel: str, cells: int) -> np.ndarray:
    """(cells + 1, cells + 1, 3) lattice on a side of the cube from -1 to 1."""
    axis, first, second, sign = _SIDES[panel]
    points = np.empty((cells + 1, cells + 1, 3))
    steps = np.linspace(-1, 1, cells + 1)
    points[..., axis], points[..., first], points[..., second] = sign, steps[:, None], steps
    return points


def _cylinder() -> MeshParts:
    """A lying drum, its caps to the front and rear."""
    length, radius = CYLINDER_M
    parts = MeshParts()
    ends = {
        "side": [[radius, -length / 2], [radius, 0.0], [radius, length / 2]],
        "front cap": [[radius, length / 2], [0.0, length / 2]],
        "rear cap": [[0.0, -length / 2], [radius, -length / 2]],
    }
    for panel, profile in ends.items():
        parts.grid(turned_along_x(np.array(profile), SEGMENTS), f"paint/{panel}")
    return parts
