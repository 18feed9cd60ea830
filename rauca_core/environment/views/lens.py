"""Cameras as the kernels of drawn views read them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...contract import Camera
from ...runtime.kernels import njit

FAR_M = 1e5  # where the sky is
NEAR_M = 0.02

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Lens:
    """A camera: ``matrix`` (3, 4) float64 from the world to pixels, ``rays`` (3, 3) float64 from homogeneous pixels to
    directions in the world (unit depth), ``eye`` (3,) float64."""

    matrix: NDArray[np.float64]
    rays: NDArray[np.float64]
    eye: NDArray[np.float64]

    @staticmethod
    def of(camera: Camera) -> Lens:
        matrix = camera.K @ np.column_stack([camera.R, camera.t])
        return Lens(matrix, camera.R.T @ np.linalg.inv(camera.K), camera.position)

    def to(self, other: Lens) -> NDArray[np.float64]:
        """(3, 4) [H | e]: what this camera sees at pixel (x, y) and depth z lies in the other at the homogeneous pixel
        ``z * H @ (x, y, 1) + e``, whose third is the depth there."""
        turned = other.matrix[:, :3] @ self.rays
        return np.column_stack([turned, other.matrix @ np.append(self.eye, 1.0)])

    def turns(self, others: Sequence[Lens]) -> NDArray[np.float64]:
        """(N, 3, 4): :meth:`to` of each, with pixels counted from their middles: what :func:`project` takes."""
        turns = np.stack([self.to(other) for other in others])
        turns[:, :2] -= 0.5 * turns[:, 2:]
        return turns

    def lengths(self, height: int, width: int) -> Image:
        """(H, W) length of every pixel's ray to depth 1: distance along the ray over depth along z."""
        x, y = np.arange(width) + 0.5, np.arange(height)[:, None] + 0.5
        (xx, xy, x1), (_, yy, y1), (_, _, one) = self.rays.T @ self.rays
        return np.sqrt((xx * x + 2 * x1) * x + one + (2 * xy * x + (yy * y + 2 * y1)) * y).astype(np.float32)


def depth_of(distance: Image, lens: Lens) -> Image:
    """(H, W) metres along z of distances along the rays; infinity, the sky, becomes :data:`FAR_M`."""
    height, width = distance.shape
    return np.minimum(distance, np.float32(FAR_M)) / lens.lengths(height, width)


@njit(cache=True, nogil=True, error_model="numpy")
def project(turn: Any, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Places among pixels' middles, and depth, of what the new camera sees at a pixel in depth z."""
    w = z * (turn[2, 0] * x + turn[2, 1] * y + turn[2, 2]) + turn[2, 3]
    inverse = 1.0 / max(w, NEAR_M)
    u = (z * (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2]) + turn[0, 3]) * inverse
    v = (z * (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2]) + turn[1, 3]) * inverse
    return u, v, w
