"""What a weather puts before what a camera sees: fog, which lets a known share of the light through, and rain.

Rain is laid over a finished frame by a seed that the plan names (`contract.rain`), so its drops are drawn once more and
undone, to the bits that half precision keeps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..contract import Dataset, Frame, Weather, load_passes, rain
from ..contract.weather import FOG_TOP_M
from .exact import Light

Array = NDArray[np.float64]

STEPS = 32  # along a ray through fog that varies
CLEARING_EDGE = 0.1  # share of fog_distance over which fog sets in, as in the scene
THINNEST = 0.05  # share of light that drops leave; behind more of them nothing is recovered


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


def drops_of(dataset: Dataset, frame: Frame, distance: NDArray[np.float16] | None = None) -> rain.Streaks:
    """The rain over a frame, no drop in dry weather.

    Args:
        distance: (H, W) metres as the frame stores them; read if None.

    Raises:
        RaucaError: the stored distances are missing or damaged.
    """
    if frame.weather.precipitation == 0.0:
        return rain.Streaks(np.zeros((frame.camera.height, frame.camera.width), np.float32), np.zeros(3, np.float32))
    if distance is None:
        distance = load_passes(dataset.frame_folder(frame.id), ("distance",))["distance"]
    seed = rain.seed_of(dataset.plan.seed, frame.location, frame.view, frame.weather)
    return rain.streaks(frame.weather, frame.camera, distance, seed)


def without_rain(light: Light, drops: rain.Streaks) -> Light:
    """Light maps as they were before ``drops`` were laid over them; those of a dry frame as they are."""
    if not drops.alpha.any():
        return light
    left = np.maximum(1.0 - drops.alpha, THINNEST)[..., None]
    return Light(light.A / left, np.maximum(light.B - drops.alpha[..., None] * drops.radiance, 0.0) / left)
