"""Rays through Embree: the benchmark's own eyes, which share no code with the rasterizer."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rauca_core.contract import Camera, RaucaError, Vehicle


class RayCaster:
    """A vehicle's mesh in Embree.

    Raises:
        RaucaError: trimesh or embreex is missing.
    """

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


def box_of(vehicle: Vehicle, camera: Camera) -> tuple[int, int, int, int]:
    """Pixels x0, y0 (inclusive), x1, y1 (exclusive) that the vehicle's projection lies within."""
    pixels, depth = camera.project(vehicle.positions.astype(np.float64))
    if (depth <= 0.02).any():
        return 0, 0, camera.width, camera.height
    low, high = np.floor(pixels.min(0)).astype(int), np.ceil(pixels.max(0)).astype(int)
    limit = np.array([camera.width, camera.height])
    (x0, y0), (x1, y1) = np.clip(low, 0, limit), np.clip(high, 0, limit)
    return int(x0), int(y0), int(x1), int(y1)
