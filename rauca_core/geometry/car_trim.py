"""Strips that follow the sedan's skin: grille bars, bumper inserts, reflectors, exhausts."""

from __future__ import annotations

import numpy as np

from .mesh import MeshParts
from .sedan_body import Body
from .sedan_parts import lathe

# On the nose and on the tail: material, from y, to y, lower z, upper z, how far it stands out; metres.
NOSE = [
    ("chrome", 0.0, 0.44, 0.690, 0.702, 0.010),
    ("chrome", 0.0, 0.42, 0.655, 0.664, 0.006),
    ("chrome", 0.0, 0.42, 0.625, 0.634, 0.006),
    ("chrome", 0.0, 0.44, 0.590, 0.602, 0.010),
    ("trim", 0.62, 0.80, 0.315, 0.395, 0.004),
    ("lens", 0.66, 0.76, 0.335, 0.378, 0.010),
]
TAIL = [
    ("chrome", 0.0, 0.36, 0.888, 0.904, 0.012),
    ("reflector", 0.56, 0.76, 0.475, 0.505, 0.006),
]
EXHAUST_Y = 0.52


def add_trim(parts: MeshParts, body: Body) -> None:
    """Add the left half of the strips."""
    for material, start, stop, low, high, lift in NOSE:
        parts.grid(body.ribbon((start, stop), (low, high), lift), material)
        _close(parts, body.ribbon((start, stop), (low, high), lift), material)
    for material, start, stop, low, high, lift in TAIL:
        strip = body.ribbon((body.tail_place - stop, body.tail_place - start), (low, high), lift)
        parts.grid(strip, material)
        _close(parts, strip[::-1], material, flip=True)
    pipe = lathe(np.array([[0.0, 0.03], [0.030, 0.03], [0.034, 0.0], [0.038, 0.0], [0.038, 0.10]]), 24)
    x = body.skin(np.array([body.tail_place - EXHAUST_Y]), np.array([0.30]))[0, 0]
    points = np.stack([pipe[..., 1] + x - 0.03, pipe[..., 0] * 1.3 + EXHAUST_Y, pipe[..., 2] + 0.285], axis=-1)
    names = np.full((24, 4), "chrome", dtype="U32")
    names[:, 0] = "gap"
    parts.grid(points, names)


def _close(parts: MeshParts, strip: np.ndarray, material: str, flip: bool = False) -> None:
    """Close the strip's outer end."""
    end = strip[-1]
    corners = np.stack([end[[0, 1, 2]], end[[0, 2, 3]]])
    parts.triangles(corners if flip else corners[:, ::-1], material)
