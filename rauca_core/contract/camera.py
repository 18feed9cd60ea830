"""Pinhole cameras in the OpenCV convention: x right, y down, z forward; metres and pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from .errors import RaucaError
from .schema import Record

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Camera(Record):
    """A pinhole camera.

    The image plane spans [0, width] x [0, height]: the center of the top-left pixel is (0.5, 0.5).

    Attributes:
        K: (3, 3) intrinsics, pixels.
        R: (3, 3) rotation, world to camera.
        t: (3,) translation, metres: ``x_camera = R @ x_world + t``.
        width, height: image size, pixels.
    """

    K: Annotated[Array, (3, 3)]
    R: Annotated[Array, (3, 3)]
    t: Annotated[Array, (3,)]
    width: Annotated[int, (1, 16384)]
    height: Annotated[int, (1, 16384)]

    @staticmethod
    def look_at(eye: Array, target: Array, fov_deg: float, width: int, height: int, roll_deg: float = 0.0) -> Camera:
        """A camera at ``eye`` (3,) facing ``target`` (3,), world z up; ``fov_deg`` is the horizontal field of view."""
        forward = np.asarray(target, float) - np.asarray(eye, float)
        length = np.linalg.norm(forward)
        if length < 1e-9:
            raise RaucaError("camera: eye and target coincide; move one of them")
        forward = forward / length
        up = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 0.9999 else np.array([1.0, 0.0, 0.0])
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        down = np.cross(forward, right)
        roll = math.radians(roll_deg)
        rows = np.stack(
            [math.cos(roll) * right + math.sin(roll) * down, math.cos(roll) * down - math.sin(roll) * right, forward]
        )
        focal = 0.5 * width / math.tan(math.radians(fov_deg) / 2)
        K = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
        return Camera(K, rows, -rows @ np.asarray(eye, float), width, height)

    @property
    def position(self) -> Array:
        """The optical center (3,) in world metres."""
        return -self.R.T @ self.t

    @property
    def fov_deg(self) -> float:
        """Horizontal field of view, degrees."""
        return math.degrees(2 * math.atan(0.5 * self.width / self.K[0, 0]))

    def project(self, points: Array) -> tuple[Array, Array]:
        """Project world points (N, 3) to pixels (N, 2) and depths (N,) along z; a depth <= 0 lies behind."""
        local = points @ self.R.T + self.t
        depth = local[:, 2]
        safe = np.where(np.abs(depth) < 1e-12, 1e-12, depth)
        pixels = local @ self.K.T
        return pixels[:, :2] / safe[:, None], depth

    def relative_to(self, object_to_world: Array) -> Camera:
        """The same camera seen from an object's own frame; ``object_to_world`` is a rigid (4, 4) transform."""
        return Camera(
            self.K, self.R @ object_to_world[:3, :3], self.R @ object_to_world[:3, 3] + self.t, self.width, self.height
        )

    def _check_whole(self, where: str) -> None:
        if self.K[0, 0] <= 0 or self.K[1, 1] <= 0 or not np.allclose(self.K[2], [0, 0, 1]):
            raise RaucaError(f"{where}: K is not a pinhole matrix (positive focal lengths, last row 0 0 1)")
        within = np.abs(self.R).max() <= 1.001  # else the product below could overflow
        if not within or not np.allclose(self.R @ self.R.T, np.eye(3), atol=1e-5) or np.linalg.det(self.R) < 0:
            raise RaucaError(f"{where}: R is not a rotation")
