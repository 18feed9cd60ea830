"""The camera that sees marked points where they were marked; its focal length may be unknown.

Pixels are square, the principal point is the picture's middle and lenses do not distort: what seven unknowns allow.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ..contract import Camera, RaucaError
from .points import MarkedPoints

Array = NDArray[np.float64]
FIELDS_DEG = np.geomspace(4.0, 120.0, 48)
"""Horizontal fields of view that a picture may have: from a long lens to a wide one."""


def solve_camera(points: MarkedPoints, width: int, height: int) -> Camera:
    """The camera in the vehicle's frame with the least squared distance, in pixels, from the marks.

    Raises:
        RaucaError: no camera sees all points in front of it.
    """
    found = [camera for fov in FIELDS_DEG if (camera := _posed(points, fov, width, height)) is not None]
    if not found:
        raise RaucaError("points: no camera sees them like this; look for two names that were swapped")
    start = min(found, key=lambda camera: reprojection_px(camera, points))
    fit = least_squares(lambda change: _misses(moved(start, change), points).ravel(), np.zeros(7), x_scale=0.01)
    return moved(start, fit.x)


def reprojection_px(camera: Camera, points: MarkedPoints) -> float:
    """Root mean square distance of the points from their marks, pixels."""
    return float(np.sqrt((_misses(camera, points) ** 2).sum(1).mean()))


def moved(camera: Camera, change: Array) -> Camera:
    """A camera near another one.

    Args:
        change: (7,) logarithm of the focal length's factor; rotation vector of the camera, radians; shift of the
            vehicle along the camera's axes, in units of its distance.
    """
    K = camera.K.copy()
    K[0, 0] *= np.exp(change[0])
    K[1, 1] *= np.exp(change[0])
    turn = cv2.Rodrigues(np.asarray(change[1:4], float))[0]
    t = camera.t + change[4:7] * np.linalg.norm(camera.t)
    # The vehicle turns about its own origin, so that rotation and shift hardly depend on each other.
    return Camera(K, turn @ camera.R, t, camera.width, camera.height)


def _misses(camera: Camera, points: MarkedPoints) -> Array:
    """(N, 2) pixels from the marks to where the camera sees the points; far away if behind it."""
    pixels, depth = camera.project(points.vehicle_m)
    return np.where(depth[:, None] > 0, pixels - points.pixels, 1e4)


def _posed(points: MarkedPoints, fov_deg: float, width: int, height: int) -> Camera | None:
    """The camera of one field of view; None when there is none."""
    focal = 0.5 * width / np.tan(np.radians(fov_deg) / 2)
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    try:
        done, turn, t = cv2.solvePnP(points.vehicle_m, points.pixels, K, np.zeros(5), flags=cv2.SOLVEPNP_SQPNP)
    except cv2.error:
        return None
    if not done or not np.isfinite(t).all():
        return None
    rotation, shift = (np.asarray(a, np.float64) for a in (cv2.Rodrigues(turn)[0], t[:, 0]))
    camera = Camera(K, rotation, shift, width, height)
    return camera if (camera.project(points.vehicle_m)[1] > 0).all() else None
