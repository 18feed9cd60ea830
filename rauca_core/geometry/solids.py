"""Smooth curves through a few readable control points; turned, boxed and swept solids that vehicles are made of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .mesh import MeshParts, Points

SAMPLES = 64  # of an outline, between two of its control points


def monotone_curve(table: Points, at: Points) -> Points:
    """Values at ``at`` of the monotone cubic (Fritsch-Carlson) through ``table`` (N, 2), constant beyond its ends.

    Unlike a plain cubic it never overshoots a control point: a flat stretch of body work stays flat.
    """
    table = table[np.argsort(table[:, 0])]
    x, y = table[:, 0], table[:, 1]
    step = np.diff(x)
    slope = np.diff(y) / step
    tangent = np.empty_like(y)
    tangent[0], tangent[-1] = slope[0], slope[-1]
    left, right = slope[:-1], slope[1:]
    weight_left, weight_right = 2 * step[1:] + step[:-1], step[1:] + 2 * step[:-1]
    same_sign = left * right > 0
    safe = np.where(
        same_sign, weight_left / np.where(same_sign, left, 1) + weight_right / np.where(same_sign, right, 1), 1
    )
    tangent[1:-1] = np.where(same_sign, (weight_left + weight_right) / safe, 0.0)
    at = np.clip(at, x[0], x[-1])
    i = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(step) - 1)
    t = (at - x[i]) / step[i]
    return (
        (1 + 2 * t) * (1 - t) ** 2 * y[i]
        + t * (1 - t) ** 2 * step[i] * tangent[i]
        + t**2 * (3 - 2 * t) * y[i + 1]
        + t**2 * (t - 1) * step[i] * tangent[i + 1]
    )


def curve_through(points: Points, at: Points) -> Points:
    """Points (N, D) of the smooth curve through control ``points`` (M, D); ``at`` (N,) runs from 0 to 1, evenly spaced
    between the control points."""
    knots = np.linspace(0.0, 1.0, len(points))
    return np.stack([monotone_curve(np.stack([knots, column], axis=1), at) for column in points.T], axis=-1)


def half_outline(control: Points) -> Points:
    """A dense polyline (N, 2) through ``control`` (M, 2), which starts and ends on the axis y = 0.

    Centripetal Catmull-Rom, mirrored at both ends so that the whole outline is smooth where it crosses the axis.
    """
    flip = np.array([1.0, -1.0])
    points = np.vstack([control[1] * flip, control, control[-2] * flip])
    pieces = []
    for p0, p1, p2, p3 in zip(points, points[1:], points[2:], points[3:], strict=False):
        knots = np.cumsum([0.0] + [np.linalg.norm(b - a) ** 0.5 for a, b in ((p0, p1), (p1, p2), (p2, p3))])
        t = np.linspace(knots[1], knots[2], SAMPLES, endpoint=False)[:, None]

        def blend(a: Points, b: Points, i: int, j: int, t: Points = t, knots: Points = knots) -> Points:
            return ((knots[j] - t) * a + (t - knots[i]) * b) / (knots[j] - knots[i])

        a1, a2, a3 = blend(p0, p1, 0, 1), blend(p1, p2, 1, 2), blend(p2, p3, 2, 3)
        pieces.append(blend(blend(a1, a2, 0, 2), blend(a2, a3, 1, 3), 1, 2))
    return np.vstack([*pieces, control[-1:]])


def smoothstep(x: Points, low: float, high: float) -> Points:
    """0 below ``low``, 1 above ``high``, smooth in between."""
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return t * t * (3 - 2 * t)


def lathe(profile: Points, segments: int) -> Points:
    """Turn a profile (N, 2) of (radius, y) around the y axis: (segments + 1, N, 3) grid."""
    angle = np.linspace(0, 2 * np.pi, segments + 1)[:, None]
    angle[-1] = 0.0  # the last column is the first, to the bit
    radius, y = profile.T
    level = np.broadcast_to(y, (segments + 1, len(y)))
    return np.stack([radius * np.cos(angle), level, radius * np.sin(angle)], axis=-1)


def add_box(
    parts: MeshParts, center: Sequence[float], size: Sequence[float], material: str, bevel: float = 0.0
) -> None:
    """Add a box, its four long edges seen along x chamfered by ``bevel``; metres."""
    half = np.array(size) / 2
    b = min(bevel, half[1] * 0.9, half[2] * 0.9)
    y, z = half[1:]
    side, height = np.array([y - b, y, y, y - b]), np.array([-z, b - z, z - b, z])
    ring = np.column_stack([np.concatenate([side, -side]), np.concatenate([height, height[::-1]])])[[*range(8), 0]]
    inset = 1 - b / max(y, z)
    scale = np.array([0.0, inset, 1.0, 1.0, inset, 0.0])
    x = np.array([-half[0], -half[0], -half[0] + b, half[0] - b, half[0], half[0]])
    points = np.empty((len(x), len(ring), 3))
    points[..., 0] = x[:, None]
    points[..., 1:] = ring * scale[:, None, None]
    parts.grid(points + np.array(center), material, flip=True)


def turned_along_x(profile: Points, segments: int) -> Points:
    """Turn a profile (N, 2) of (radius, x) around the x axis: (segments + 1, N, 3) grid.

    The grid faces outwards where the profile runs forward (+x) on the outside.
    """
    across, along, up = np.moveaxis(lathe(profile, segments), -1, 0)
    return np.stack([along, across, up], axis=-1)


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


def add_solids(parts: MeshParts, rows: list[dict[str, Any]]) -> None:
    """Add what a list of a profile names: boxes, bars, and turned profiles, which may stand ``upright``."""
    for row in rows:
        if "box" in row:
            add_box(parts, row["box"][:3], row["box"][3:], row["material"], row["bevel"])
        elif "bar" in row:
            add_tube(parts, np.array(row["bar"]), row["radius"], row["material"], row["sides"])
        else:
            points = turned_along_x(np.array(row["turned"]), row["segments"])
            if row.get("upright"):
                points = points[..., [2, 1, 0]] * [-1, 1, 1]
            parts.grid(points + np.array(row["center"]), row["material"])
