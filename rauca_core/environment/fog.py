"""How much of the light from a point reaches the camera through a weather's fog."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..contract import Weather
from ..contract.weather import FOG_TOP_M

Array = NDArray[np.float64]

STEPS = 32  # along a ray through fog that varies
CLEARING_EDGE = 0.1  # share of fog_distance over which fog sets in, as in the scene


def transmittance(weather: Weather, eye: Array, points: Array) -> Array:
    """Share of light (N,) in (0, 1] that neither fog nor haze scatters on its way; 1 without fog.

    Args:
        eye: (3,) the camera, metres, in a frame whose z is up from the ground: the vehicle's own will do.
        points: (N, 3) what it sees, in the same frame.
    """
    points = np.asarray(points, np.float64)
    length = np.linalg.norm(points - eye, axis=1)
    if weather.extinction == 0.0:
        return np.ones(len(points))
    along = (np.arange(STEPS) + 0.5) / STEPS
    height = eye[2] + along * (points[:, 2, None] - eye[2])
    density = np.where(height < FOG_TOP_M, np.exp2(-weather.fog_falloff * np.maximum(height, 0.0) / 10), 0.0)
    if weather.fog_distance > 0:
        beyond = (length[:, None] * along - weather.fog_distance) / (CLEARING_EDGE * weather.fog_distance + 1e-3)
        density = density * np.clip(beyond, 0.0, 1.0)
    return np.exp(-weather.extinction * length * density.mean(1))
