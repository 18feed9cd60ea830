"""How well a vehicle's silhouette lies on a picture's mask, and the camera nearby where it lies best."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ..contract import Camera, Vehicle
from ..environment.views.body import see_body
from .points import MarkedPoints
from .solve import moved

Array = NDArray[np.float64]
BLURS = (1 / 64, 1 / 256)  # of the picture's width: the first pulls from afar, the second settles
STEP_PX = 0.5  # by which the camera is moved to see what changes
POINT_WEIGHT = 0.05
"""Of a marked point's miss of one pixel beside a pixel of coverage: marks are rough, and there are few of them."""


def coverage(vehicle: Vehicle, camera: Camera) -> NDArray[np.float32]:
    """(H, W) share of each pixel that the vehicle covers; the camera is in the vehicle's frame."""
    return see_body(vehicle, camera).vehicle


def iou(one: NDArray[np.floating], two: NDArray[np.floating]) -> float:
    """Intersection over union of two masks (H, W), each at half coverage; 0 when both are empty."""
    a, b = one >= 0.5, two >= 0.5
    return float((a & b).sum() / max((a | b).sum(), 1))


def refine(vehicle: Vehicle, start: Camera, mask: NDArray[np.floating], points: MarkedPoints | None = None) -> Camera:
    """The camera near ``start`` whose silhouette is closest to ``mask`` (H, W) in [0, 1], blurred and less so.

    Least squares of blurred coverage, by finite differences: the edge's shift in pixels is what the residuals measure.
    """
    camera = start
    step = STEP_PX / camera.K[0, 0]
    for share in BLURS:
        sigma = max(share * camera.width, 1.0)
        wanted = _blurred(mask.astype(np.float32), sigma)
        misses = partial(_misses, vehicle, camera, wanted, sigma, points)
        fit = least_squares(misses, np.zeros(7), jac=partial(_slopes, misses, 2 * step), max_nfev=8, x_scale=0.01)
        camera = moved(camera, fit.x)
    return camera


def _misses(
    vehicle: Vehicle, begin: Camera, wanted: Array, sigma: float, points: MarkedPoints | None, change: Array
) -> Array:
    """What least squares makes small for a camera moved from ``begin``: blurred coverage, and the points' misses."""
    near = moved(begin, change)
    shape = (_blurred(coverage(vehicle, near), sigma) - wanted).ravel()
    if points is None:
        return shape
    away = near.project(points.vehicle_m)[0] - points.pixels
    return np.concatenate([shape, POINT_WEIGHT * away.ravel()])


def _slopes(misses: Callable[[Array], Array], step: float, change: Array) -> Array:
    """Central differences of the misses by each unknown."""
    sides = [(misses(change + d), misses(change - d)) for d in np.eye(len(change)) * step]
    return np.stack([(up - down) / (2 * step) for up, down in sides], 1)


def _blurred(image: NDArray[np.float32], sigma: float) -> Array:
    """A Gaussian's blur, then every few pixels of it: no more is left to see."""
    blurred = cv2.GaussianBlur(image, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
    every = max(int(sigma / 2), 1)
    return blurred[::every, ::every].astype(np.float64)
