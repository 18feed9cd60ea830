"""Strips that follow a car's skin: grille bars, bumper inserts, reflectors, exhausts."""

from __future__ import annotations

import numpy as np

from .car_body import Body
from .mesh import MeshParts
from .solids import lathe


def add_trim(parts: MeshParts, body: Body) -> None:
    """Add the left half of the strips and the exhaust."""
    details = body.profile["details"]
    for material, start, stop, low, high, lift in details["nose"]:
        parts.grid(body.ribbon((start, stop), (low, high), lift), material)
        _close(parts, body.ribbon((start, stop), (low, high), lift), material)
    for material, start, stop, low, high, lift in details["tail"]:
        strip = body.ribbon((body.tail_place - stop, body.tail_place - start), (low, high), lift)
        parts.grid(strip, material)
        _close(parts, strip[::-1], material, flip=True)
    if "exhaust" in details:
        _add_exhaust(parts, body, *details["exhaust"])


def _add_exhaust(parts: MeshParts, body: Body, y: float, z: float) -> None:
    """A tail pipe through the bumper."""
    pipe = lathe(np.array([[0.0, 0.03], [0.030, 0.03], [0.034, 0.0], [0.038, 0.0], [0.038, 0.10]]), 24)
    x = body.skin(np.array([body.tail_place - y]), np.array([z + 0.015]))[0, 0]
    points = np.stack([pipe[..., 1] + x - 0.03, pipe[..., 0] * 1.3 + y, pipe[..., 2] + z], axis=-1)
    names = np.full((24, 4), "chrome", dtype="U32")
    names[:, 0] = "gap"
    parts.grid(points, names)


def _close(parts: MeshParts, strip: np.ndarray, material: str, flip: bool = False) -> None:
    """Close the strip's outer end."""
    end = strip[-1]
    corners = np.stack([end[[0, 1, 2]], end[[0, 2, 3]]])
    parts.triangles(corners if flip else corners[:, ::-1], material)
