"""The camera of a picture: given, or solved from marked points and settled by the silhouette; and how well it fits."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..contract import Camera, RaucaError, Vehicle
from ..contract.schema import read_json
from .points import MarkedPoints
from .silhouette import coverage, iou, refine
from .solve import reprojection_px, solve_camera


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
