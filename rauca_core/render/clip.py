"""Clipping in homogeneous image space, before any division: a camera may stand inside the mesh."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

MAX_CORNERS = 9  # a triangle gains at most one corner per plane: 3 + 5, and one to spare


def clip_planes(width: int, height: int, guard: float) -> Array:
    """Planes (5, 3) on homogeneous pixel coordinates (X, Y, w); ``plane @ point >= 0`` is kept.

    The first is the near plane, at w = 0 until :func:`clip_face` moves it. The others are a guard band ``guard``
    pixels outside the image, so that vertices at any distance fit the rasteriser's fixed-point numbers.
    """
    return np.array(
        [
            [0.0, 0.0, 1.0],
            [1.0, 0.0, guard],
            [-1.0, 0.0, width + guard],
            [0.0, 1.0, guard],
            [0.0, -1.0, height + guard],
        ]
    )


@njit(cache=True)
def clip_face(corners: Array, planes: Array, near: float, polygon: Array, spare: Array) -> int:
    """Sutherland-Hodgman: clip a triangle (3, 3) against ``planes`` into ``polygon``; returns the corner count.

    An intersection is always computed from its inner end, so two faces that share an edge clip it to the same bits and
    stay watertight.
    """
    count = 3
    polygon[:3] = corners
    for p in range(planes.shape[0]):
        offset = near if p == 0 else 0.0
        kept = 0
        for i in range(count):
            here, there = polygon[i], polygon[(i + 1) % count]
            d_here = planes[p, 0] * here[0] + planes[p, 1] * here[1] + planes[p, 2] * here[2] - offset
            d_there = planes[p, 0] * there[0] + planes[p, 1] * there[1] + planes[p, 2] * there[2] - offset
            if d_here >= 0.0:
                spare[kept] = here
                kept += 1
            if (d_here >= 0.0) != (d_there >= 0.0):
                if d_here >= 0.0:
                    spare[kept] = here + (d_here / (d_here - d_there)) * (there - here)
                else:
                    spare[kept] = there + (d_there / (d_there - d_here)) * (here - there)
                kept += 1
        count = kept
        polygon[:count] = spare[:count]
        if count < 3:
            return 0
    return count
