"""Cameras, textures, and what a pixel ought to show: 16 x 16 rays, each with one unfiltered bilinear lookup.

Rays through Embree and a plain loop over subsamples: nothing here is shared with the renderer that is judged by it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numba import njit
from numpy.typing import NDArray

from rauca_core.contract import Camera, RaucaError, Vehicle
from rauca_core.render import Pyramid

STRIP_RAYS = 2_000_000  # at once; bounds memory
TEXTURES = ("noise", "photograph-like")
GOLDEN = (5**0.5 - 1) / 2  # steps of a golden share never line up with a car's symmetry
# Field of view in degrees, nearest and farthest in metres: the paper's ring, and one in which the car fills the frame.
RINGS = {"paper": (90.0, 5.0, 15.0), "close": (60.0, 4.2, 4.8)}
ELEVATIONS_DEG = (5.0, 50.0)
Map = NDArray[np.float32]


def ring(vehicle: Vehicle, name: str, number: int, size: int) -> list[Camera]:
    """``number`` cameras around the vehicle, square, ``size`` pixels; elevations and distances go in golden steps."""
    fov, near, far = RINGS[name]
    low, high = ELEVATIONS_DEG
    cameras = []
    for i in range(number):
        share = (i * GOLDEN + 0.5) % 1
        distance = 1 / (share / near + (1 - share) / far)  # even steps in apparent size
        elevation = low + (high - low) * ((i * GOLDEN**2 + 0.25) % 1)
        cameras.append(_orbit(vehicle, 360.0 * (i + 0.37) / number, elevation, distance, fov, size))
    return cameras


def random_cameras(vehicle: Vehicle, number: int, size: int, seed: int = 0) -> list[Camera]:
    """Cameras that all see the car, from anywhere above the ground, rolled."""
    rng = np.random.default_rng(seed)
    cameras = []
    for _ in range(number):
        azimuth, elevation = rng.uniform(0, 360), rng.uniform(0, 70)
        distance, fov = rng.uniform(4, 15), rng.uniform(40, 90)
        aim, roll = rng.uniform(-0.5, 0.5, 3), rng.uniform(-15, 15)
        cameras.append(_orbit(vehicle, azimuth, elevation, distance, fov, size, aim, roll))
    return cameras


def _orbit(
    vehicle: Vehicle, azimuth: float, elevation: float, distance: float, fov: float, size: int,
    shift: np.ndarray | float = 0.0, roll: float = 0.0,
) -> Camera:  # fmt: skip
    """A camera at angles in degrees around the middle of the vehicle, looking at it ``shift`` metres off."""
    middle = (vehicle.positions.max(0) + vehicle.positions.min(0)).astype(np.float64) / 2
    a, e = np.radians([azimuth, elevation])
    eye = middle + distance * np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    return Camera.look_at(eye, middle + shift, fov, size, size, roll)


def uv_map(kind: str, pyramid: Pyramid, seed: int = 0) -> Map:
    """A UV map (size, size, 3), linear, gutters filled; ``noise`` is uniform texels, the hardest for a sampler."""
    rng, size = np.random.default_rng(seed), pyramid.size
    drawn = rng.random((size, size, 3), dtype=np.float32) if kind == "noise" else _photograph(size, rng)
    texels = pyramid.from_map(torch.from_numpy(drawn.transpose(2, 0, 1).copy()))
    return np.ascontiguousarray(pyramid.to_map(texels).permute(1, 2, 0).numpy())


def _photograph(size: int, rng: np.random.Generator) -> Map:
    """Discs of all sizes over one another (dead leaves), and 1/f noise: the statistics of natural images."""
    image = np.full((size, size, 3), 0.5, np.float32)
    smallest, largest, number = size / 512, size / 6, 20_000  # enough to cover the map several times
    # Radii of density r^-3 make the pattern look the same at every scale.
    radii = (smallest**-2 - rng.random(number) * (smallest**-2 - largest**-2)) ** -0.5
    for radius, x, y in zip(radii, *(rng.random((2, number)) * size), strict=True):
        x0, x1 = max(0, int(x - radius)), min(size, int(x + radius) + 1)
        y0, y1 = max(0, int(y - radius)), min(size, int(y + radius) + 1)
        disc = np.hypot(np.arange(x0, x1)[None] + 0.5 - x, np.arange(y0, y1)[:, None] + 0.5 - y) < radius
        image[y0:y1, x0:x1][disc] = rng.random(3)
    return np.clip(image + 0.1 * _pink(size, rng), 0, 1).astype(np.float32)


def _pink(size: int, rng: np.random.Generator) -> Map:
    """Noise (size, size, 3) of amplitude 1/f, mean 0, deviation 1."""
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None])
    frequency[0, 0] = np.inf
    planes = [np.fft.irfft2(np.fft.rfft2(rng.standard_normal((size, size))) / frequency) for _ in range(3)]
    return np.stack([p / p.std() for p in planes], 2).astype(np.float32)


class RayCaster:
    """A vehicle's mesh in Embree; raises :class:`RaucaError` where trimesh or embreex is missing."""

    def __init__(self, vehicle: Vehicle) -> None:
        try:
            import trimesh
            from trimesh.ray.ray_pyembree import RayMeshIntersector
        except ImportError as error:
            raise RaucaError("bench render: Embree is missing; `pip install rauca[bench]` installs it") from error
        mesh = trimesh.Trimesh(vehicle.positions, vehicle.triangles, process=False)
        self.intersector: Any = RayMeshIntersector(mesh)
        self.scene = self.intersector._scene  # what intersects_first asks after copying its arguments

    def first_faces(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> NDArray[np.int32]:
        """The face (n,) that each ray (n, 3) meets first, or -1."""
        return np.asarray(self.scene.run(origins, directions), np.int32)


def ray_directions(camera: Camera, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unnormalized directions (n, 3) through image points x, y (n,) in pixels; z in the camera is 1."""
    points = np.stack([x, y, np.ones_like(x)], 1)
    return points @ np.linalg.inv(camera.K).T @ camera.R


def box_of(vehicle: Vehicle, camera: Camera, margin: int = 0) -> tuple[int, int, int, int]:
    """Pixels x0, y0 (inclusive), x1, y1 (exclusive) that the vehicle's projection lies within, and a margin."""
    pixels, depth = camera.project(vehicle.positions.astype(np.float64))
    if (depth <= 0.02).any():
        return 0, 0, camera.width, camera.height
    low, high = np.floor(pixels.min(0)).astype(int) - margin, np.ceil(pixels.max(0)).astype(int) + margin
    limit = np.array([camera.width, camera.height])
    (x0, y0), (x1, y1) = np.clip(low, 0, limit), np.clip(high, 0, limit)
    return int(x0), int(y0), int(x1), int(y1)


@dataclass(frozen=True, eq=False)
class Reference:
    """One view, by the box filter; colors are premultiplied and linear, with each of K textures."""

    coverage: NDArray[np.float64]  # (H, W)
    colors: NDArray[np.float64]  # (K, H, W, 3)
    touched: NDArray[np.bool_]  # (size, size), the texels that any subsample's lookup weighs


def render_reference(vehicle: Vehicle, caster: RayCaster, camera: Camera, maps: Map, samples: int) -> Reference:
    """Render UV maps (K, size, size, 3) with ``samples`` x ``samples`` rays per pixel on a regular grid."""
    height, width = camera.height, camera.width
    coverage, colors = np.zeros((height, width)), np.zeros((len(maps), height, width, 3))
    touched = np.zeros(maps.shape[1:3], bool)
    x0, y0, x1, y1 = box_of(vehicle, camera)
    planes = ray_planes(vehicle, camera.position)
    paint, uvs = vehicle.paint_faces(), vehicle.uvs.astype(np.float64)
    columns = x0 + (np.arange((x1 - x0) * samples) + 0.5) / samples
    strip = max(1, STRIP_RAYS // max(1, len(columns) * samples))
    for top in range(y0, y1, strip):
        bottom = min(top + strip, y1)
        rows = top + (np.arange((bottom - top) * samples) + 0.5) / samples
        x, y = np.meshgrid(columns, rows)
        directions = ray_directions(camera, x.ravel(), y.ravel())
        origins = np.broadcast_to(camera.position.astype(np.float32), directions.shape).copy()
        faces = caster.first_faces(origins, directions.astype(np.float32)).reshape(x.shape)
        window = (slice(top, bottom), slice(x0, x1))
        _shade(
            faces, directions.reshape(*x.shape, 3), planes, paint, uvs, vehicle.paint_mask, maps, samples,
            coverage[window], colors[:, window[0], window[1]], touched,
        )  # fmt: skip
    return Reference(coverage, colors, touched)


def ray_planes(vehicle: Vehicle, eye: NDArray[np.float64]) -> NDArray[np.float64]:
    """(F, 3, 3): ``direction @ planes[face]`` is proportional to the barycentrics where a ray from ``eye`` meets it."""
    a, b, c = (vehicle.positions[vehicle.triangles[:, k]].astype(np.float64) - eye for k in range(3))
    planes = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], 2)
    return planes * np.where(np.einsum("ni,ni->n", a, planes[..., 0]) < 0, -1.0, 1.0)[:, None, None]


@njit(cache=True)
def _shade(
    faces: Any, directions: Any, planes: Any, paint: Any, uvs: Any, mask: Any, maps: Any, samples: int,
    coverage: Any, colors: Any, touched: Any,
) -> None:  # fmt: skip
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
