"""Pixels whose depth is that of nothing: other views look right through the point where they say that something is.

A rendered distance is a mean over the pixel. Where that mixes a pole with what lies behind it, the point floats between
both, and would be thrown before whatever a new camera sees. One view alone cannot always tell; the others can.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...render.kernels import njit
from .lens import FAR_M, NEAR_M, Image, Lens, Mask, project
from .sources import SAME_POINT

BEYOND = 0.06  # of the depth, by which it must be farther to have looked through it


def flying(lenses: Sequence[Lens], depth: Image) -> Mask:
    """(N, H, W): True on pixels that some other view looks through and none confirms.

    Args:
        depth: (N, H, W) metres along z, 0 where not known; the sky, :data:`lens.FAR_M`, is never called flying.
    """
    found = np.zeros(depth.shape, bool)
    for n, lens in enumerate(lenses):
        _flying(depth, n, lens.turns(lenses), found[n])
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def _flying(depths: Any, own: int, turns: Any, found: Any) -> None:
    count, height, width = depths.shape
    for row in range(height):
        y = row + 0.5
        for column in range(width):
            z, x, through, confirmed = depths[own, row, column], column + 0.5, False, False
            if z <= 0.0 or z > 0.5 * FAR_M:
                continue
            for m in range(count):
                if m == own:
                    continue
                u, v, w = project(turns[m], x, y, z)
                if w < NEAR_M:
                    continue
                left, top = int(np.floor(u)), int(np.floor(v))
                if left < 0 or top < 0 or left >= width - 1 or top >= height - 1:
                    continue
                beyond = True
                for i in range(4):
                    there = depths[m, top + i // 2, left + i % 2]
                    confirmed = confirmed or abs(there - w) <= SAME_POINT * w
                    beyond = beyond and there > (1.0 + BEYOND) * w
                through = through or beyond
                if confirmed:
                    break
            found[row, column] = through and not confirmed
