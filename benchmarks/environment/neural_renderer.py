"""Which face each pixel sees, the way Neural Renderer finds it: every pixel is tested against every face.

The published base loop renders so at every step, once per color. Ours takes milliseconds for the same picture, which
makes *base* cheap. What the published way would cost on this machine is timed here on some of a picture's rows.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rauca_core.contract import Camera, Vehicle

SUBSAMPLES = 2  # per axis, as published


def find_faces(vehicle: Vehicle, camera_in_vehicle: Camera, every: int = 1) -> NDArray[np.int32]:
    """Ids (SUBSAMPLES * H, SUBSAMPLES * W) of the nearest faces, -1 where there is none.

    Faces that reach behind the camera are left out; of ``every`` rows one is tested, the others stay at -1.
    """
    camera = camera_in_vehicle
    seen = vehicle.positions @ camera.R.T + camera.t
    depth = seen[:, 2]
    pixels = (seen @ camera.K.T)[:, :2] / np.where(depth > 0, depth, 1)[:, None] * SUBSAMPLES
    corners = np.concatenate([pixels, depth[:, None]], 1)[vehicle.triangles]
    whole = (corners[..., 2] > 0).all(1)
    corners[~whole] = 0  # no area, so never hit
    return _test_all(corners.astype(np.float32), camera.height * SUBSAMPLES, camera.width * SUBSAMPLES, every)


def seconds_per_image(vehicle: Vehicle, camera_in_vehicle: Camera, every: int = 32) -> float:
    """CPU time of a whole picture, from one row in ``every``."""
    find_faces(vehicle, camera_in_vehicle, camera_in_vehicle.height * SUBSAMPLES)  # compiles
    started = time.process_time()
    find_faces(vehicle, camera_in_vehicle, every)
    return (time.process_time() - started) * every


@njit(cache=True)
def _test_all(corners: Any, height: int, width: int, every: int) -> Any:
    """corners (F, 3, 3): x, y in subsamples, depth."""
    found = np.full((height, width), -1, np.int32)
    for row in range(0, height, every):
        y = np.float32(row + 0.5)
        for column in range(width):
            x = np.float32(column + 0.5)
            nearest = np.float32(0.0)
            for face in range(corners.shape[0]):
                c = corners[face]
                a = (c[1, 0] - x) * (c[2, 1] - y) - (c[2, 0] - x) * (c[1, 1] - y)
                b = (c[2, 0] - x) * (c[0, 1] - y) - (c[0, 0] - x) * (c[2, 1] - y)
                d = (c[0, 0] - x) * (c[1, 1] - y) - (c[1, 0] - x) * (c[0, 1] - y)
                if (a > 0 and b > 0 and d > 0) or (a < 0 and b < 0 and d < 0):
                    # 1 / depth is linear in the image.
                    inverse = (a / c[0, 2] + b / c[1, 2] + d / c[2, 2]) / (a + b + d)
                    if inverse > nearest:
                        nearest, found[row, column] = inverse, face
    return found
