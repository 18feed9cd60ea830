"""Which evaluated frames show the vehicle as a camera of the scene does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..core import contract
from .found import Sight

SAME = 0.015  # of the picture's side: how far a corner of the vehicle may lie from where it was


class Views:
    """The cameras of evaluated frames, ready to be compared with others."""

    def __init__(self, sights: Sequence[Sight]) -> None:
        self.sights = list(sights)
        matrices = [_projection(sight.camera) for sight in self.sights]
        self._matrices = np.array(matrices).reshape(-1, 3, 4)

    def distances(self, corners: NDArray[np.float64], seen: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far each frame is from a view.

        Args:
            corners: (8, 3) points of the vehicle, in its own frame, metres.
            seen: (8, 2) where the view shows them, in [0, 1] of its width and height, from the top left.

        Returns:
            (frames,) the largest distance of a corner from where the frame shows it, in pictures; infinite where a
            corner lies behind the camera.
        """
        homogeneous = np.concatenate([corners, np.ones((len(corners), 1))], axis=1)
        projected = np.einsum("nij,kj->nki", self._matrices, homogeneous)
        depth = projected[..., 2]
        places = projected[..., :2] / np.where(depth > 1e-6, depth, np.nan)[..., None]
        away = np.abs(places - seen).max(axis=(1, 2))
        return np.where(np.isfinite(away), away, np.inf)

    def same(self, corners: NDArray[np.float64], seen: NDArray[np.float64]) -> list[Sight]:
        """The frames that show the vehicle like a view (see :meth:`distances`), in every weather."""
        away = self.distances(corners, seen)
        return [sight for sight, distance in zip(self.sights, away, strict=True) if distance < SAME]


def camera_in_world(camera: contract.Camera, vehicle_to_world: NDArray[np.float64]) -> contract.Camera:
    """A camera given in the vehicle's frame, in the world."""
    turn, place = vehicle_to_world[:3, :3], vehicle_to_world[:3, 3]
    R = camera.R @ turn.T
    return contract.Camera(camera.K, R, camera.t - R @ place, camera.width, camera.height)


def _projection(camera: contract.Camera) -> NDArray[np.float64]:
    """(3, 4) from the vehicle's frame to fractions of the picture."""
    scale = np.diag([1 / camera.width, 1 / camera.height, 1.0])
    return scale @ camera.K @ np.concatenate([camera.R, camera.t[:, None]], axis=1)
