"""The colors of a new view: the point that a pixel sees is looked up in every source, between its four pixels.

Of these only those count whose own distance says that they see this very point, so that colors never leak over an
edge. Sources are weighed by how much their line of sight differs from the new one: what mirrors differs too. What no
source saw is filled in from what lies nearest in the picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...runtime.kernels import njit
from .lens import NEAR_M, Image, Lens, project
from .sources import SAME_POINT, Sources

SAME_POINT_M = 0.01  # and so many metres more
SLOPES = 1.5  # and so many steps to the next pixel of a slope
FADE = 8.0  # pixels over which a source fades out towards its border
ASKED = 2  # sources that make a pixel, at most: a third brings a frame 0.03 dB, for a tenth of the time
LEAST_SHARE = 0.1  # of a lookup's four pixels that must see the point


@dataclass(frozen=True, eq=False)
class Gathered:
    """What sources say of a new view.

    Attributes:
        values: (H, W, C) float32 their weighted mean; 0 where none sees the point.
        labels: (H, W, L) uint8 of the nearest pixel of the source that counts most.
        weight: (H, W) float32, 0 where no source sees the point.
    """

    values: Image
    labels: NDArray[np.uint8]
    weight: Image


def gather(
    sources: Sources,
    chosen: NDArray[np.int64],
    depth: Image,
    lens: Lens,
    sharpness: float,
    same_point: float = SAME_POINT,
) -> Gathered:
    """Look up the points of a new view's ``depth`` (H, W) in the first :data:`ASKED` of ``chosen`` that see them.

    Args:
        depth: metres along z; 0 where nothing is to be looked up.
        sharpness: how fast a source's weight falls with the angle between its line of sight and the new one: at
            1 / sharpness radians it is a half.
        same_point: of the depth, by which that of a source may differ.
    """
    height, width = depth.shape
    values = np.zeros((height, width, sources.values.shape[-1]), np.float32)
    labels = np.zeros((height, width, sources.labels.shape[-1]), np.uint8)
    weight = np.zeros((height, width), np.float32)
    asides = np.stack([lens.eye - sources.lenses[n].eye for n in chosen.tolist()])
    turns = lens.turns([sources.lenses[n] for n in chosen.tolist()])
    _gather(
        (sources.depth, sources.values, sources.labels), (chosen, turns, asides), depth, lens.rays,
        (sharpness**2, same_point, ASKED), (values, labels, weight),
    )  # fmt: skip
    return Gathered(values, labels, weight)


def refine(sources: Sources, chosen: NDArray[np.int64], depth: Image, lens: Lens) -> Image:
    """A splat's depth (H, W) is that of a source pixel's middle, off by half a pixel's slope: one step towards the
    depth that the first source which sees the point has there."""
    found = depth.copy()
    _refine(sources.depth, chosen, lens.turns([sources.lenses[n] for n in chosen.tolist()]), SAME_POINT, found)
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def _gather(source: Any, packed: Any, depth: Any, rays: Any, rule: Any, found: Any) -> None:
    depths, colors, ids = source
    chosen, turns, asides = packed
    sharpness, same_point, asked = rule
    values, labels, weight = found
    height, width = depths.shape[1:]
    channels, shares = values.shape[2], np.zeros(4)
    for row in range(depth.shape[0]):
        y = row + 0.5
        for column in range(depth.shape[1]):
            z = depth[row, column]
            if z <= 0.0:
                continue
            x = column + 0.5
            dx = z * (rays[0, 0] * x + rays[0, 1] * y + rays[0, 2])
            dy = z * (rays[1, 0] * x + rays[1, 1] * y + rays[1, 2])
            dz = z * (rays[2, 0] * x + rays[2, 1] * y + rays[2, 2])
            here, met, best, whole = dx * dx + dy * dy + dz * dz, 0, 0.0, 0.0
            best_source = best_row = best_column = 0
            for k in range(chosen.shape[0]):
                u, v, w = project(turns[k], x, y, z)
                if w < NEAR_M or not (-0.5 <= u < width - 0.5 and -0.5 <= v < height - 0.5):
                    continue
                n = chosen[k]
                total = _agreed(depths[n], u, v, w, same_point, shares)
                if total < LEAST_SHARE:
                    continue
                # The angle between both lines of sight, squared: the source's is the new one and the step aside.
                step = dx * asides[k, 0] + dy * asides[k, 1] + dz * asides[k, 2]
                there = here + 2.0 * step + asides[k, 0] ** 2 + asides[k, 1] ** 2 + asides[k, 2] ** 2
                angle = max(2.0 - 2.0 * (here + step) / np.sqrt(here * there), 0.0) * sharpness
                border = min(min(u, width - 1 - u), min(v, height - 1 - v)) * (1.0 / FADE)
                strength = min(max(border, 0.02), 1.0) / ((1.0 + angle * angle) * max(there / here, 1.0))
                left, top = int(np.floor(u)), int(np.floor(v))
                _add(colors, n, top, left, strength, shares, total == 1.0, values, row, column)
                largest = 0
                for i in range(1, 4):
                    if shares[i] > shares[largest]:
                        largest = i
                strength *= total
                whole += strength
                if strength > best:
                    best, best_source = strength, n
                    best_row, best_column = top + largest // 2, left + largest % 2
                met += 1
                if met == asked:
                    break
            if met > 0:
                weight[row, column], inverse = whole, 1.0 / whole
                for channel in range(channels):
                    values[row, column, channel] *= inverse
                for channel in range(labels.shape[2]):
                    labels[row, column, channel] = ids[best_source, best_row, best_column, channel]


@njit(cache=True, nogil=True, error_model="numpy")
def _add(
    colors: Any,
    n: int,
    top: int,
    left: int,
    strength: float,
    shares: Any,
    whole: bool,
    values: Any,
    row: int,
    column: int,
) -> None:
    """Add what source n shows at a place to a pixel's values; ``whole`` where all its four pixels count."""
    if whole:
        a, b, c, d = strength * shares[0], strength * shares[1], strength * shares[2], strength * shares[3]
        for channel in range(values.shape[2]):
            upper = a * colors[n, top, left, channel] + b * colors[n, top, left + 1, channel]
            lower = c * colors[n, top + 1, left, channel] + d * colors[n, top + 1, left + 1, channel]
            values[row, column, channel] += upper + lower
        return
    for i in range(4):
        if shares[i] > 0.0:
            for channel in range(values.shape[2]):
                values[row, column, channel] += strength * shares[i] * colors[n, top + i // 2, left + i % 2, channel]


@njit(cache=True, nogil=True, error_model="numpy")
def _refine(depths: Any, chosen: Any, turns: Any, same_point: float, found: Any) -> None:
    height, width = depths.shape[1:]
    shares = np.zeros(4)
    for row in range(found.shape[0]):
        for column in range(found.shape[1]):
            z = found[row, column]
            if z <= 0.0:
                continue
            for k in range(chosen.shape[0]):
                n = chosen[k]
                u, v, w = project(turns[k], column + 0.5, row + 0.5, z)
                if w < NEAR_M or not (-0.5 <= u < width - 0.5 and -0.5 <= v < height - 0.5):
                    continue
                total = _agreed(depths[n], u, v, w, same_point, shares)
                if total < LEAST_SHARE:
                    continue
                left, top, mean = int(np.floor(u)), int(np.floor(v)), 0.0
                for i in range(4):
                    if shares[i] > 0.0:
                        mean += shares[i] * depths[n, top + i // 2, left + i % 2]
                found[row, column] = z * mean / (total * w)
                break


@njit(cache=True, nogil=True, error_model="numpy")
def _agreed(depths: Any, u: float, v: float, w: float, same_point: float, shares: Any) -> float:
    """Bilinear shares of the four pixels around a place, 0 for those that do not see a point of depth w; their sum."""
    height, width = depths.shape
    left, top, total = int(np.floor(u)), int(np.floor(v)), 0.0
    right_share, low_share = u - left, v - top
    limit = same_point * w + SAME_POINT_M
    if 0 <= left < width - 1 and 0 <= top < height - 1:  # nearly always all four see it: depth 0 is far off as well
        upper = max(abs(depths[top, left] - w), abs(depths[top, left + 1] - w))
        lower = max(abs(depths[top + 1, left] - w), abs(depths[top + 1, left + 1] - w))
        if max(upper, lower) <= min(limit, 0.5 * w):
            shares[0], shares[1] = (1.0 - right_share) * (1.0 - low_share), right_share * (1.0 - low_share)
            shares[2], shares[3] = (1.0 - right_share) * low_share, right_share * low_share
            return 1.0
    for i in range(4):
        shares[i] = 0.0
        r, c = top + i // 2, left + i % 2
        if r < 0 or c < 0 or r >= height or c >= width:
            continue
        there = depths[r, c]
        if there <= 0.0:
            continue
        off = abs(there - w)
        # On a slope neighbors differ by more: allowed is what the step to the pixel beyond is.
        if off > limit and off > limit + SLOPES * _slope(depths, r, c):
            continue
        shares[i] = (right_share if i % 2 else 1.0 - right_share) * (low_share if i // 2 else 1.0 - low_share)
        total += shares[i]
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _slope(depths: Any, row: int, column: int) -> float:
    """The smaller of the steps in depth to the two sides, the larger of rows and columns: a slope's, not an edge's."""
    height, width = depths.shape
    here, found = depths[row, column], 0.0
    if 0 < column < width - 1 and depths[row, column - 1] > 0.0 and depths[row, column + 1] > 0.0:
        found = min(abs(depths[row, column - 1] - here), abs(depths[row, column + 1] - here))
    if 0 < row < height - 1 and depths[row - 1, column] > 0.0 and depths[row + 1, column] > 0.0:
        found = max(found, min(abs(depths[row - 1, column] - here), abs(depths[row + 1, column] - here)))
    return found


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
