"""The camera of a picture: given, or solved from marked points and settled by the silhouette; and how well it fits.

Where it is solved, its focal length may be unknown. Pixels are square, the principal point is the picture's middle and
lenses do not distort: what seven unknowns allow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ..contract import Camera, RaucaError, Vehicle
from ..contract.schema import read_json
from ..environment.views.body import see_body
from .points import MarkedPoints

Array = NDArray[np.float64]
FIELDS_DEG = np.geomspace(4.0, 120.0, 48)
"""Horizontal fields of view that a picture may have: from a long lens to a wide one."""
BLURS = (1 / 64, 1 / 256)  # of the picture's width: the first pulls from afar, the second settles
STEP_PX = 0.5  # by which the camera is moved to see what changes
POINT_WEIGHT = 0.05
"""Of a marked point's miss of one pixel beside a pixel of coverage: marks are rough, and there are few of them."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A camera and what it sees.

    Attributes:
        camera: in the vehicle's frame.
        coverage: (H, W) of the vehicle through it, in [0, 1].
        solved_px: root mean square miss of the marked points before the silhouette was asked; None without points.
        points_px: the same of ``camera``.
        iou: of the coverage and the picture's mask; None without a mask.
    """

    camera: Camera
    coverage: NDArray[np.float32]
    solved_px: float | None = None
    points_px: float | None = None
    iou: float | None = None


def fit_points(vehicle: Vehicle, points: MarkedPoints, mask: NDArray[np.float32] | None, size: tuple[int, int]) -> Fit:
    """Solve the camera from points; with a mask (H, W) in [0, 1] it is refined by the silhouette.

    Args:
        size: width and height of the picture, pixels.

    Raises:
        RaucaError: no camera sees the points like this.
    """
    solved = solve_camera(points, *size)
    camera = solved if mask is None else refine(vehicle, solved, mask, points)
    fit = fit_camera(vehicle, camera, mask)
    return Fit(camera, fit.coverage, reprojection_px(solved, points), reprojection_px(camera, points), fit.iou)


def fit_camera(vehicle: Vehicle, camera: Camera, mask: NDArray[np.float32] | None) -> Fit:
    """What a known camera sees."""
    seen = coverage(vehicle, camera)
    return Fit(camera, seen, iou=None if mask is None else iou(seen, mask))


def read_camera(path: Path, width: int, height: int) -> Camera:
    """A camera's file; raises :class:`RaucaError` for one that is damaged or of another size than the picture."""
    camera = Camera.from_json(read_json(path))
    if (camera.width, camera.height) != (width, height):
        raise RaucaError(f"{path}: of {camera.width}x{camera.height} pixels, the picture has {width}x{height}")
    return camera


def solve_camera(points: MarkedPoints, width: int, height: int) -> Camera:
    """The camera in the vehicle's frame with the least squared distance, in pixels, from the marks.

    Raises:
        RaucaError: no camera sees all points in front of it.
    """
    found = [camera for fov in FIELDS_DEG if (camera := _posed(points, fov, width, height)) is not None]
    if not found:
        raise RaucaError("points: no camera sees them like this; look for two names that were swapped")
    start = min(found, key=lambda camera: reprojection_px(camera, points))
    fit = least_squares(lambda change: _marks_missed(moved(start, change), points).ravel(), np.zeros(7), x_scale=0.01)
    return moved(start, fit.x)


def reprojection_px(camera: Camera, points: MarkedPoints) -> float:
    """Root mean square distance of the points from their marks, pixels."""
    return float(np.sqrt((_marks_missed(camera, points) ** 2).sum(1).mean()))


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


def _marks_missed(camera: Camera, points: MarkedPoints) -> Array:
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
