"""Turned, boxed and swept solids that parts of any vehicle are made of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .mesh import MeshParts

Points = NDArray[np.float64]


def lathe(profile: Points, segments: int) -> Points:
    """Turn a profile (N, 2) of (radius, y) around the y axis: (segments + 1, N, 3) grid."""
    angle = np.linspace(0, 2 * np.pi, segments + 1)[:, None]
    angle[-1] = 0.0  # the last column is the first, to the bit
    return np.stack(
        [
            profile[:, 0] * np.cos(angle),
            np.broadcast_to(profile[:, 1], (segments + 1, len(profile))),
            profile[:, 0] * np.sin(angle),
        ],
        axis=-1,
    )


def add_box(
    parts: MeshParts, center: tuple[float, ...], size: tuple[float, ...], material: str, bevel: float = 0.0
) -> None:
    """Add a box, its four long edges seen along x chamfered by ``bevel``; metres."""
    half = np.array(size) / 2
    b = min(bevel, half[1] * 0.9, half[2] * 0.9)
    ring = np.array(
        [
            [half[1] - b, -half[2]],
            [half[1], -half[2] + b],
            [half[1], half[2] - b],
            [half[1] - b, half[2]],
            [-half[1] + b, half[2]],
            [-half[1], half[2] - b],
            [-half[1], -half[2] + b],
            [-half[1] + b, -half[2]],
        ]
    )
    scale = np.array([0.0, 1 - b / max(half[1], half[2]), 1.0, 1.0, 1 - b / max(half[1], half[2]), 0.0])
    x = np.array([-half[0], -half[0], -half[0] + b, half[0] - b, half[0], half[0]])
    ring = np.vstack([ring, ring[:1]])
    points = np.empty((len(x), len(ring), 3))
    points[..., 0] = x[:, None]
    points[..., 1:] = ring * scale[:, None, None]
    parts.grid(points + np.array(center), material, flip=True)


def turned_along_x(profile: Points, segments: int, center: tuple[float, float, float]) -> Points:
    """Turn a profile (N, 2) of (radius, x) around the x axis through ``center``: (segments + 1, N, 3) grid.

    The grid faces outwards where the profile runs forward (+x) on the outside.
    """
    across, along, up = np.moveaxis(lathe(profile, segments), -1, 0)
    return np.stack([along, across, up], axis=-1) + np.array(center)


def add_tube(parts: MeshParts, path: Points, radius: float, material: str, sides: int = 6) -> None:
    """A round bar along a polyline ``path`` (N, 3) that is nowhere vertical or nowhere level; capped ends."""
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    upright = np.abs(along[:, 2]).min() > 0.5
    side = np.cross(along, np.array([1.0, 0, 0]) if upright else np.array([0, 0, 1.0]))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, along)
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    angle[-1] = 0.0
    ring = side[:, None] * np.cos(angle)[:, None] + up[:, None] * np.sin(angle)[:, None]
    points = path[:, None] + radius * ring
    first, last = (np.repeat(path[[i], None], sides + 1, axis=1) for i in (0, -1))
    parts.grid(np.concatenate([first, points, last]), material)
