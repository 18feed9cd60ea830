"""Smooth curves through a few readable control points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]


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


def half_outline(control: Points, samples: int = 64) -> Points:
    """A dense polyline (N, 2) through ``control`` (M, 2), which starts and ends on the axis y = 0.

    Centripetal Catmull-Rom, mirrored at both ends so that the whole outline is smooth where it crosses the axis.
    """
    flip = np.array([1.0, -1.0])
    points = np.vstack([control[1] * flip, control, control[-2] * flip])
    pieces = []
    for p0, p1, p2, p3 in zip(points, points[1:], points[2:], points[3:], strict=False):
        knots = np.cumsum([0.0] + [np.linalg.norm(b - a) ** 0.5 for a, b in ((p0, p1), (p1, p2), (p2, p3))])
        t = np.linspace(knots[1], knots[2], samples, endpoint=False)[:, None]

        def blend(a: Points, b: Points, i: int, j: int, t: Points = t, knots: Points = knots) -> Points:
            return ((knots[j] - t) * a + (t - knots[i]) * b) / (knots[j] - knots[i])

        a1, a2, a3 = blend(p0, p1, 0, 1), blend(p1, p2, 1, 2), blend(p2, p3, 2, 3)
        pieces.append(blend(blend(a1, a2, 0, 2), blend(a2, a3, 1, 3), 1, 2))
    return np.vstack([*pieces, control[-1:]])


def smoothstep(x: Points, low: float, high: float) -> Points:
    """0 below ``low``, 1 above ``high``, smooth in between."""
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return t * t * (3 - 2 * t)
