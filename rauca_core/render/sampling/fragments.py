"""From visible subsamples to texels: which texels each fragment reads, and how much paint it shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...contract import Vehicle
from ..kernels import njit
from ..mipmap import Pyramid
from ..raster.pattern import PLACES
from ..raster.rasterize import Raster

TEXELS = 4  # a bilinear lookup in one mip level


@dataclass(frozen=True, eq=False)
class Fragments:
    """Painted fragments of one view.

    Attributes:
        index: (h, w) int32 over the raster's window, the fragment of a sample or -1.
        texels: (N, K) int32 places in the pyramid's list; unused ones have weight 0.
        weights: (N, K) float32, each row sums to 1.
        paint: (N,) float32 paint mask in [0, 1] at the fragment.
    """

    index: NDArray[np.int32]
    texels: NDArray[np.int32]
    weights: NDArray[np.float32]
    paint: NDArray[np.float32]


def find_fragments(vehicle: Vehicle, raster: Raster, pyramid: Pyramid) -> Fragments:
    """Look up the texels of every visible subsample of a paint face.

    The mip level is the one whose texels are about as large as the footprint of one lookup. Visibility needs many
    samples, texture many lookups: where samples are few, each looks at 2 x 2 places of its square, within its face. UVs
    are clamped to the map; faces without area in the atlas read one texel at the finest level.
    """
    visible = raster.face_ids >= 0
    painted = np.zeros_like(visible)
    painted[visible] = vehicle.paint_faces()[raster.face_ids[visible]]
    index = np.full(raster.face_ids.shape, -1, np.int32)
    number = int(painted.sum())
    index[painted] = np.arange(number, dtype=np.int32)
    pattern = raster.pattern
    probes = 1 if pattern.number >= PLACES else 2
    fragments = Fragments(
        index,
        np.zeros((number, TEXELS * probes**2), np.int32),
        np.zeros((number, TEXELS * probes**2), np.float32),
        np.zeros(number, np.float32),
    )
    starts = np.concatenate([[0], np.cumsum([s.size for s in pyramid.slots])]).astype(np.int64)
    slots = np.concatenate([s.ravel() for s in pyramid.slots])
    coverage = np.concatenate([c.ravel() for c in pyramid.coverage])
    _look_up(
        (index, raster.face_ids, raster.planes),
        (raster.x0, raster.y0, raster.margin, pattern.columns, pattern.shifts),
        pattern.side / probes,
        (vehicle.uvs.astype(np.float64), vehicle.paint_mask),
        (slots, coverage, starts, np.array(pyramid.sizes)),
        probes,
        (fragments.texels, fragments.weights, fragments.paint),
    )
    return fragments


@njit(cache=True, nogil=True)
def _look_up(seen: Any, place: Any, side: float, surface: Any, levels: Any, probes: int, found: Any) -> None:
    index, face_ids, planes = seen
    x0, y0, margin, columns, shifts = place
    uvs, mask = surface
    texels, weights, paint = found
    rows = shifts.shape[0]
    for row in range(index.shape[0]):
        for column in range(index.shape[1]):
            n = index[row, column]
            if n < 0:
                continue
            face = face_ids[row, column]
            x = (x0 + column + shifts[(y0 + row) % rows]) / columns - margin
            y = (y0 + row + 0.5) / rows - margin
            u, v, footprint = _texture_coordinates(planes[face], uvs[face], x, y)
            paint[n] = _bilinear_mask(mask, u, v)
            met = 0
            for k in range(probes * probes):
                if probes > 1:
                    across, down = k % probes - 0.5 * (probes - 1), k // probes - 0.5 * (probes - 1)
                    place = x + across * side, y + down * side
                    u, v, footprint = _texture_coordinates(planes[face], uvs[face], place[0], place[1])
                met += _read(levels, u, v, footprint * side, texels[n, TEXELS * k :], weights[n, TEXELS * k :])
            if met == 0:
                paint[n] = 0.0
            if met > 1:
                for k in range(weights.shape[1]):
                    weights[n, k] /= met


@njit(cache=True, nogil=True)
def _read(levels: Any, u: float, v: float, footprint: float, texels: Any, weights: Any) -> int:
    """Read the level of a footprint; 1, or 0 when nothing paintable lies near."""
    slots, coverage, starts, sizes = levels
    level = min(max(int(np.rint(np.log2(max(footprint * sizes[0], 1e-9)))), 0), len(sizes) - 1)
    while level < len(sizes):
        if _bilinear(slots, coverage, starts[level], sizes[level], u, v, texels, weights):
            return 1
        level += 1  # nothing paintable this near at this level: a coarser one reaches further
    return 0


@njit(cache=True, nogil=True)
def _texture_coordinates(plane: Any, uv: Any, x: float, y: float) -> tuple[float, float, float]:
    """u, v in [0, 1] at pixel coordinates, and the side of a pixel's footprint in units of the map."""
    total = u = v = ux = uy = vx = vy = dx = dy = 0.0
    for k in range(3):
        over_depth = max(plane[0, k] * x + plane[1, k] * y + plane[2, k], 0.0)
        total += over_depth
        u += over_depth * uv[k, 0]
        v += over_depth * uv[k, 1]
        dx += plane[0, k]
        dy += plane[1, k]
        ux += plane[0, k] * uv[k, 0]
        uy += plane[1, k] * uv[k, 0]
        vx += plane[0, k] * uv[k, 1]
        vy += plane[1, k] * uv[k, 1]
    total = max(total, 1e-300)
    u, v = u / total, v / total
    ux, uy, vx, vy = (ux - u * dx) / total, (uy - u * dy) / total, (vx - v * dx) / total, (vy - v * dy) / total
    area, square = abs(ux * vy - uy * vx), ux * ux + uy * uy + vx * vx + vy * vy
    longest = np.sqrt(0.5 * (square + np.sqrt(max(square * square - 4.0 * area * area, 0.0))))
    # The square of equal area. Where that is so long that bilinear lookups would leap over texels, wide enough not to:
    # every texel that a view shows then has a tap, which seen at a grazing angle it had not.
    footprint = max(np.sqrt(area), 0.5 * longest)
    return min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0), footprint


@njit(cache=True, nogil=True)
def _bilinear_mask(mask: Any, u: float, v: float) -> float:
    height, width = mask.shape
    x = min(max(u * width - 0.5, 0.0), width - 1.0)
    y = min(max((1.0 - v) * height - 0.5, 0.0), height - 1.0)
    left, top = min(int(x), max(width - 2, 0)), min(int(y), max(height - 2, 0))
    right, bottom = min(left + 1, width - 1), min(top + 1, height - 1)
    fx, fy = x - left, y - top
    upper = mask[top, left] * (1 - fx) + mask[top, right] * fx
    lower = mask[bottom, left] * (1 - fx) + mask[bottom, right] * fx
    return (upper * (1 - fy) + lower * fy) / 255.0


@njit(cache=True, nogil=True)
def _bilinear(slots: Any, coverage: Any, start: int, side: int, u: float, v: float, texels: Any, weights: Any) -> bool:
    """Coverage-weighted bilinear lookup in one level; False when none of its texels is paintable."""
    x = min(max(u * side - 0.5, 0.0), side - 1.0)
    y = min(max((1.0 - v) * side - 0.5, 0.0), side - 1.0)
    left, top = int(x), int(y)
    fx, fy = x - left, y - top
    total = 0.0
    for k in range(4):
        column, row = min(left + k % 2, side - 1), min(top + k // 2, side - 1)
        place = start + row * side + column
        weight = (fx if k % 2 else 1.0 - fx) * (fy if k // 2 else 1.0 - fy)
        texels[k] = max(slots[place], 0)
        weights[k] = weight * coverage[place]
        total += weight * coverage[place]
    found = total >= 1e-6
    for k in range(4):
        weights[k] = weights[k] / total if found else 0.0
    return found
