"""What a pixel ought to show: 16 x 16 rays, each with one unfiltered bilinear texel lookup, averaged.

Rays through Embree and a plain loop over subsamples: nothing here is shared with the renderer that is judged by it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rauca_core.contract import Camera, Vehicle
from rauca_core.render import rasterize
from rauca_core.render.raster.pattern import pattern

from .embree import RayCaster, box_of, ray_directions

STRIP_RAYS = 2_000_000  # at once; bounds memory

# (x, y, directions), all of a strip of rays (h, w[, 3]) -> the face (h, w) that each meets first, or -1.
See = Callable[[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]], NDArray[np.int32]]


@dataclass(frozen=True, eq=False)
class Reference:
    """One view.

    Attributes:
        coverage: (H, W) share of the paint in each pixel, box filter.
        colors: (K, H, W, 3) premultiplied linear paint color with each of K textures.
        touched: (size, size) bool, the texels that any subsample's lookup weighs.
    """

    coverage: NDArray[np.float64]
    colors: NDArray[np.float64]
    touched: NDArray[np.bool_]


def render_reference(vehicle: Vehicle, see: See, camera: Camera, maps: NDArray[np.float32], samples: int) -> Reference:
    """Render UV maps (K, size, size, 3) with ``samples`` x ``samples`` rays per pixel on a regular grid."""
    height, width = camera.height, camera.width
    coverage, colors = np.zeros((height, width)), np.zeros((len(maps), height, width, 3))
    touched = np.zeros(maps.shape[1:3], bool)
    x0, y0, x1, y1 = box_of(vehicle, camera)
    eye = camera.position
    planes = ray_planes(vehicle, eye)
    paint, uvs = vehicle.paint_faces(), vehicle.uvs.astype(np.float64)
    columns = x0 + (np.arange((x1 - x0) * samples) + 0.5) / samples
    strip = max(1, STRIP_RAYS // max(1, len(columns) * samples))
    for top in range(y0, y1, strip):
        bottom = min(top + strip, y1)
        rows = top + (np.arange((bottom - top) * samples) + 0.5) / samples
        grid_x, grid_y = np.meshgrid(columns, rows)
        directions = ray_directions(camera, grid_x.ravel(), grid_y.ravel()).reshape(*grid_x.shape, 3)
        window = (slice(top, bottom), slice(x0, x1))
        _shade(
            see(grid_x, grid_y, directions),
            directions,
            planes,
            paint,
            uvs,
            vehicle.paint_mask,
            maps,
            samples,
            coverage[window],
            colors[:, window[0], window[1]],
            touched,
        )
    return Reference(coverage, colors, touched)


def embree_sees(caster: RayCaster, camera: Camera) -> See:
    """Visibility by rays."""

    def see(x: NDArray[np.float64], y: NDArray[np.float64], directions: NDArray[np.float64]) -> NDArray[np.int32]:
        flat = directions.reshape(-1, 3).astype(np.float32)
        origins = np.broadcast_to(camera.position.astype(np.float32), flat.shape).copy()
        return caster.first_faces(origins, flat).reshape(x.shape)

    return see


def raster_sees(vehicle: Vehicle, camera: Camera, samples: int) -> See:
    """Visibility by the rasterizer under test, to tell how much it matters who looks."""
    raster = rasterize(vehicle.positions, vehicle.triangles, camera, pattern=pattern(samples, "grid"))
    whole = raster.whole(camera.width, camera.height)

    def see(x: NDArray[np.float64], y: NDArray[np.float64], directions: NDArray[np.float64]) -> NDArray[np.int32]:
        return np.ascontiguousarray(whole[(y * samples).astype(int), (x * samples).astype(int)])

    return see


def ray_planes(vehicle: Vehicle, eye: NDArray[np.float64]) -> NDArray[np.float64]:
    """(F, 3, 3): ``direction @ planes[face]`` is proportional to the barycentrics where a ray from ``eye`` meets it."""
    a, b, c = (vehicle.positions[vehicle.triangles[:, k]].astype(np.float64) - eye for k in range(3))
    planes = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], 2)
    return planes * np.where(np.einsum("ni,ni->n", a, planes[..., 0]) < 0, -1.0, 1.0)[:, None, None]


@njit(cache=True)
def _shade(
    faces: Any,
    directions: Any,
    planes: Any,
    paint: Any,
    uvs: Any,
    mask: Any,
    maps: Any,
    samples: int,
    coverage: Any,
    colors: Any,
    touched: Any,
) -> None:
    share = 1.0 / (samples * samples)
    size = maps.shape[1]
    for row in range(faces.shape[0]):
        for column in range(faces.shape[1]):
            face = faces[row, column]
            if face < 0 or not paint[face]:
                continue
            y, x = row // samples, column // samples
            u, v = _uv(directions[row, column], planes[face], uvs[face])
            left, top, right, bottom, fx, fy = _corners(u, v, mask.shape[0])
            upper = mask[top, left] * (1 - fx) + mask[top, right] * fx
            lower = mask[bottom, left] * (1 - fx) + mask[bottom, right] * fx
            weight = share * (upper * (1 - fy) + lower * fy) / 255.0
            if weight == 0.0:
                continue
            coverage[y, x] += weight
            left, top, right, bottom, fx, fy = _corners(u, v, size)
            for j, i, part in (
                (top, left, (1 - fy) * (1 - fx)),
                (top, right, (1 - fy) * fx),
                (bottom, left, fy * (1 - fx)),
                (bottom, right, fy * fx),
            ):
                if part <= 0.0:
                    continue
                touched[j, i] = True
                for k in range(maps.shape[0]):
                    for channel in range(3):
                        colors[k, y, x, channel] += weight * part * maps[k, j, i, channel]


@njit(cache=True)
def _uv(direction: Any, plane: Any, uv: Any) -> tuple[float, float]:
    u = v = total = 0.0
    for k in range(3):
        part = max(direction[0] * plane[0, k] + direction[1] * plane[1, k] + direction[2] * plane[2, k], 0.0)
        total += part
        u += part * uv[k, 0]
        v += part * uv[k, 1]
    total = max(total, 1e-300)
    return min(max(u / total, 0.0), 1.0), min(max(v / total, 0.0), 1.0)


@njit(cache=True)
def _corners(u: float, v: float, size: int) -> tuple[int, int, int, int, float, float]:
    """The four texels around a point of a square map, and the point's place between them."""
    x = min(max(u * size - 0.5, 0.0), size - 1.0)
    y = min(max((1.0 - v) * size - 0.5, 0.0), size - 1.0)
    left, top = int(x), int(y)
    return left, top, min(left + 1, size - 1), min(top + 1, size - 1), x - left, y - top
