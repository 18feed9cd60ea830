"""Rendered views as others are made of them: which of their pixels may be used, and what they hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...runtime.kernels import njit
from .lens import FAR_M, NEAR_M, Image, Lens, Mask, project

SAME_POINT = 0.02  # of the depth, by which two views of one point may differ
BEYOND = 0.06  # of the depth, by which something must be farther to have looked through a point
MIXED_JUMP = 0.06  # of the inverse depth, relative: pixels on such an edge may hold a mean of both sides
MIXED_SHARE = 0.15  # of the jump: nearer to one side than this, a pixel belongs to it


@dataclass(frozen=True, eq=False)
class Sources:
    """N views of one place.

    Attributes:
        lenses: of each.
        depth: (N, H, W) float32 metres along z, :data:`lens.FAR_M` for sky; 0 where a pixel is not to be used.
        values: (N, H, W, C) float32 what is carried over.
        labels: (N, H, W, L) uint8 what is carried over without blending.
    """

    lenses: tuple[Lens, ...]
    depth: Image
    values: Image
    labels: NDArray[np.uint8]


def mixed(depth: Image) -> Mask:
    """(H, W): True on pixels whose depth lies between those of their neighbors on both sides of a jump.

    A rendered distance is a mean over the pixel: on a silhouette it is that of neither surface. Of a plane the inverse
    depth is linear in the image: a slope is no jump.
    """
    inverse = 1.0 / np.maximum(depth, np.float32(1e-3))
    found = np.zeros(depth.shape, bool)
    for axis in (0, 1):
        before, here, after = (np.take(inverse, range(k, inverse.shape[axis] - 2 + k), axis) for k in range(3))
        low, high = np.minimum(before, after), np.maximum(before, after)
        jump = high - low
        off = np.minimum(here - low, high - here)
        between = (jump > MIXED_JUMP * high) & (off > MIXED_SHARE * jump)
        # A slope passes through the middle: there the pixel beyond goes on as steeply. An edge stops.
        inner = [slice(None), slice(None)]
        inner[axis] = slice(1, -1)
        found[tuple(inner)] |= between & ~_goes_on(inverse, axis)
    return found


def _goes_on(inverse: Image, axis: int) -> Mask:
    """Whether the steps on both sides of a pixel are alike and go on beyond its neighbors."""
    padded = np.pad(inverse, [(1, 1) if a == axis else (0, 0) for a in (0, 1)], mode="reflect", reflect_type="odd")
    steps = np.abs(np.diff(padded, axis=axis))
    count = inverse.shape[axis] - 2
    four = np.stack([np.take(steps, range(k, count + k), axis) for k in range(4)])
    return four.min(0) > 0.4 * four.max(0)


def flying(lenses: Sequence[Lens], depth: Image) -> Mask:
    """(N, H, W): True on pixels whose depth is that of nothing: some other view looks through it and none confirms it.

    A rendered distance is a mean over the pixel. Where that mixes a pole with what lies behind it, the point floats
    between both, and would be thrown before whatever a new camera sees. One view alone cannot always tell; the others
    can.

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
