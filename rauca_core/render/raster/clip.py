"""Clipping in homogeneous pixel coordinates, before any division: a camera may stand inside the mesh."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..kernels import njit
from .fixed_point import INSIDE, ONE, OUTSIDE

MAX_CORNERS = 9  # a triangle gains at most one corner per plane: 3 + 5, and one to spare


@njit(cache=True, nogil=True, error_model="numpy")
def clip_faces(points: Any, over: Any, fixed: Any, state: Any, triangles: Any, planes: Any, near: float) -> Any:
    """Replace faces across the clip planes by fans of new corners; faces of broken vertices, by nothing.

    Args:
        points, over, fixed, state: of the vertices, see `project.Vertices`.
        triangles: (F, 3) vertex indices.
        planes, near: see `fixed_point.Screen`.

    Returns:
        corners (T, 3) int32 and owners (T,) int32 of the triangles to draw, by ascending face; over and fixed, with
        the new corners appended.
    """
    across = 0
    for f in range(triangles.shape[0]):
        across += (state[triangles[f, 0]] | state[triangles[f, 1]] | state[triangles[f, 2]]) == OUTSIDE
    corners = np.empty((triangles.shape[0] + across * MAX_CORNERS, 3), np.int32)
    owners = np.empty(len(corners), np.int32)
    vertices = len(over)
    over = np.concatenate((over, np.empty(across * MAX_CORNERS)))
    fixed = np.concatenate((fixed, np.empty((2, across * MAX_CORNERS), np.int32)), 1)
    polygon, spare = np.empty((MAX_CORNERS, 3)), np.empty((MAX_CORNERS, 3))
    drawn = 0
    for f in range(triangles.shape[0]):
        i, j, k = triangles[f, 0], triangles[f, 1], triangles[f, 2]
        where = state[i] | state[j] | state[k]
        if where == INSIDE:
            corners[drawn, 0], corners[drawn, 1], corners[drawn, 2], owners[drawn] = i, j, k, f
            drawn += 1
        elif where == OUTSIDE:
            for axis in range(3):
                polygon[0, axis], polygon[1, axis], polygon[2, axis] = points[axis, i], points[axis, j], points[axis, k]
            count = _clip(planes, near, polygon, spare)
            for n in range(count):
                inverse = 1.0 / max(polygon[n, 2], near)
                over[vertices + n] = inverse
                for axis in range(2):  # rounding may leave a corner a little outside
                    low, high = -planes[1 + 2 * axis, 2], planes[2 + 2 * axis, 2]
                    place = min(max(polygon[n, axis] * inverse, low), high)
                    fixed[axis, vertices + n] = np.int32(np.rint(place * ONE))
            for n in range(1, count - 1):
                corners[drawn, 0], corners[drawn, 1], corners[drawn, 2] = vertices, vertices + n, vertices + n + 1
                owners[drawn] = f
                drawn += 1
            vertices += count
    return corners[:drawn], owners[:drawn], over[:vertices], fixed[:, :vertices].copy()


@njit(cache=True, nogil=True, error_model="numpy")
def _clip(planes: Any, near: float, polygon: Any, spare: Any) -> int:
    """Sutherland-Hodgman: clip the triangle in ``polygon`` in place; returns the corner count.

    An intersection is always computed from the end nearer to the plane, so two faces that share an edge clip it to the
    same bits and stay watertight, and one that ends a light year away still meets the plane.
    """
    count = 3
    for p in range(planes.shape[0]):
        offset = near if p == 0 else 0.0
        kept = 0
        for i in range(count):
            here, there = polygon[i], polygon[(i + 1) % count]
            d_here = planes[p, 0] * here[0] + planes[p, 1] * here[1] + planes[p, 2] * here[2] - offset
            d_there = planes[p, 0] * there[0] + planes[p, 1] * there[1] + planes[p, 2] * there[2] - offset
            if d_here >= 0.0:
                for axis in range(3):  # whole rows at once would take numba ten times as long to compile
                    spare[kept, axis] = here[axis]
                kept += 1
            if (d_here >= 0.0) != (d_there >= 0.0):
                if abs(d_here) < abs(d_there) or (d_here >= 0.0 and d_here == -d_there):
                    start, end, share = here, there, d_here / (d_here - d_there)
                else:
                    start, end, share = there, here, d_there / (d_there - d_here)
                for axis in range(3):
                    spare[kept, axis] = start[axis] + share * (end[axis] - start[axis])
                kept += 1
        count = kept
        for i in range(count):
            for axis in range(3):
                polygon[i, axis] = spare[i, axis]
        if count < 3:
            return 0
    return count
