"""A cabin: four leaning walls with windows, and a roof that stands out over them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .mesh import MeshParts

Points = NDArray[np.float64]
CROWN_M = 0.04  # the roof is this much higher in the middle


def add_house(parts: MeshParts, house: dict[str, Any]) -> None:
    """Add the left half of a cabin.

    Args:
        house: ``front_x``, ``rear_x``, ``half_width`` at the foot, each followed by its value at the top; ``z`` of foot
            and top, ``windows_z`` between which the glass lies, ``side_windows`` and ``front_windows`` as pairs of
            fractions along the wall (0: rear, or middle), ``rear_windows`` likewise; ``roof`` overhang to the front,
            side and rear, and its thickness; metres.
    """
    z = np.array([house["z"][0], *house["windows_z"], house["z"][1]])
    rise = (z - z[0]) / (z[-1] - z[0])
    leaning = (house[key] for key in ("front_x", "rear_x", "half_width"))
    front, rear, side = (foot + (top - foot) * rise for foot, top in leaning)
    along = _cuts(house["side_windows"])
    wall = np.empty((len(along), len(z), 3))
    wall[..., 0] = rear + (front - rear) * along[:, None]
    wall[..., 1], wall[..., 2] = side, z
    parts.grid(wall, _glazed(along, house["side_windows"], "paint/house side"), flip=True)
    for x, key, panel, flip in (
        (front, "front_windows", "paint/house front", False),
        (rear, "rear_windows", "paint/house rear", True),
    ):
        across = _cuts(house[key])
        wall = np.empty((len(across), len(z), 3))
        wall[..., 0], wall[..., 1], wall[..., 2] = x, side * across[:, None], z
        parts.grid(wall, _glazed(across, house[key], panel), flip=flip)
    ahead, aside, behind, thick = house["roof"]
    _add_roof(parts, (rear[-1] - behind, front[-1] + ahead), side[-1] + aside, z[-1], thick)


def _cuts(windows: list[list[float]]) -> Points:
    return np.unique([0.0, 1.0, *(edge for pair in windows for edge in pair)])


def _glazed(cuts: Points, windows: list[list[float]], panel: str) -> NDArray[np.str_]:
    """Materials of a wall's cells: glass in the middle of its three rows where a window is."""
    names = np.full((len(cuts) - 1, 3), panel, dtype="U32")
    middle = 0.5 * (cuts[1:] + cuts[:-1])
    for start, stop in windows:
        names[(middle > start) & (middle < stop), 1] = "glass"
    return names


def _add_roof(parts: MeshParts, x: tuple[float, float], half_width: float, z: float, thick: float) -> None:
    """A slab with bevelled edges, crowned."""
    bevel = thick / 3
    across = np.linspace(0.0, 1.0, 5)

    def ring(inset: float, height: float, crown: float = 0.0) -> Points:
        """(2, 5, 3) the slab's front and rear edge, from the middle to the left."""
        points = np.empty((2, len(across), 3))
        points[0, :, 0], points[1, :, 0] = x[1] - inset, x[0] + inset
        points[..., 1], points[..., 2] = (half_width - inset) * across, z + height + crown * (1 - across**2)
        return points

    crowned = [ring(0.0, thick - bevel, CROWN_M), ring(bevel, thick, CROWN_M)]
    rings = [ring(bevel, 0.0), ring(0.0, bevel), *crowned]
    parts.grid(np.array([np.concatenate([r[0], r[1, ::-1]]) for r in rings]), "paint/roof", flip=True)
    parts.grid(rings[-1][::-1], "paint/roof")
    parts.grid(rings[0][::-1], "dark", flip=True)
