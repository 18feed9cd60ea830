"""The depth of a new view: every pixel of every source is thrown at the place where the new camera sees its point.

The nearest wins. A splat is as large as its pixel and a little larger, so that surfaces seen from nearby have no gaps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...runtime.kernels import njit
from .lens import NEAR_M, Image, Lens
from .sources import Sources

LARGEST_SPLAT = 3  # pixels to each side


def splat(sources: Sources, chosen: NDArray[np.int64], lens: Lens, height: int, width: int) -> Image:
    """Depth (H, W) of a new view, metres along z; 0 where no source has anything to show."""
    depth = np.full((height, width), np.inf, np.float32)
    for n in chosen:
        _splat(sources.depth[n], sources.lenses[n].to(lens), depth)
    depth[np.isinf(depth)] = 0.0
    return _close(depth)


@njit(cache=True, nogil=True, error_model="numpy")
def _splat(depth: Any, turn: Any, nearest: Any) -> None:
    height, width = nearest.shape
    for row in range(depth.shape[0]):
        y = row + 0.5
        along = turn[:, 1] * y + turn[:, 2]
        for column in range(depth.shape[1]):
            z = depth[row, column]
            if z <= 0.0:
                continue
            x = column + 0.5
            w = z * (turn[2, 0] * x + along[2]) + turn[2, 3]
            if w < NEAR_M:
                continue
            inverse = 1.0 / w
            half = min(0.5 * max(z * inverse, 1.0) + 0.1, LARGEST_SPLAT + 0.5)
            u = (z * (turn[0, 0] * x + along[0]) + turn[0, 3]) * inverse - 0.5
            v = (z * (turn[1, 0] * x + along[1]) + turn[1, 3]) * inverse - 0.5
            if u < -half or v < -half or u > width - 1 + half or v > height - 1 + half:
                continue
            left, right = int(np.ceil(u - half)), int(np.floor(u + half))
            top, bottom = int(np.ceil(v - half)), int(np.floor(v + half))
            for r in range(max(top, 0), min(bottom, height - 1) + 1):
                for c in range(max(left, 0), min(right, width - 1) + 1):
                    if w < nearest[r, c]:
                        nearest[r, c] = w


@njit(cache=True, nogil=True)
def _close(depth: Any) -> Any:
    """Pixels without a depth that lie between such with one, above and below or to both sides, take their mean."""
    closed = depth.copy()
    height, width = depth.shape
    for r in range(height):
        for c in range(width):
            if depth[r, c] > 0.0:
                continue
            best = 0.0
            if 0 < c < width - 1 and depth[r, c - 1] > 0.0 and depth[r, c + 1] > 0.0:
                best = max(depth[r, c - 1], depth[r, c + 1])
            if 0 < r < height - 1 and depth[r - 1, c] > 0.0 and depth[r + 1, c] > 0.0:
                best = max(best, depth[r - 1, c], depth[r + 1, c])
            closed[r, c] = best
    return closed


def farther(depth: Image, weight: Image) -> Image:
    """What else pixels may show whose depth no source confirmed (``weight`` 0): 0 at all others.

    A splat is as large as its pixel and a little larger: along silhouettes it covers what lies behind. So the farthest
    confirmed depth of the neighbors is tried.
    """
    return _farther(depth, weight)


@njit(cache=True, nogil=True)
def _farther(depth: Any, weight: Any) -> Any:
    height, width = depth.shape
    found = np.zeros(depth.shape, np.float32)
    for r in range(height):
        for c in range(width):
            if weight[r, c] > 0.0:
                continue
            best = np.float32(0.0)
            for rr in range(max(r - 1, 0), min(r + 2, height)):
                for cc in range(max(c - 1, 0), min(c + 2, width)):
                    if weight[rr, cc] > 0.0:
                        best = max(best, depth[rr, cc])
            found[r, c] = best
    return found
