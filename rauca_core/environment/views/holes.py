"""What no source saw: filled in from what lies nearest in the picture."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...render.kernels import njit


@njit(cache=True, nogil=True, error_model="numpy")
def fill_holes(values: Any, known: Any) -> None:
    """Give every pixel of ``values`` (H, W, C) that is not ``known`` (H, W) the mean of the nearest known ones.

    In place; row by row and column by column: of the four known pixels met to the left, right, above and below, each
    by the inverse square of its distance. Where a whole image knows nothing, 0 stays.
    """
    height, width, channels = values.shape
    below = np.full((height, width), height, np.int32)  # the row of the nearest known pixel; height is none
    for r in range(height - 1, -1, -1):
        for c in range(width):
            if known[r, c]:
                below[r, c] = r
            elif r + 1 < height:
                below[r, c] = below[r + 1, c]
    above, right = np.full(width, -1, np.int32), np.empty(width, np.int32)
    for r in range(height):
        ahead = width
        for c in range(width - 1, -1, -1):
            if known[r, c]:
                ahead = c
            right[c] = ahead
        left = -1
        for c in range(width):
            if known[r, c]:
                left, above[c] = c, r
                continue
            total = 0.0
            for side in range(4):
                if side == 0:
                    rr, cc, step = r, left, c - left
                elif side == 1:
                    rr, cc, step = r, right[c], right[c] - c
                elif side == 2:
                    rr, cc, step = above[c], c, r - above[c]
                else:
                    rr, cc, step = below[r, c], c, below[r, c] - r
                if rr < 0 or cc < 0 or rr == height or cc == width:
                    continue
                weight = 1.0 / (step * step)
                total += weight
                for channel in range(channels):
                    values[r, c, channel] += weight * values[rr, cc, channel]
            if total > 0.0:
                for channel in range(channels):
                    values[r, c, channel] /= total
