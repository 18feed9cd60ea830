"""Rain taken out of a frame's light maps again.

Rain is laid over a finished frame by a seed that the plan names (`contract.rain`), so its drops are drawn once more and
undone, to the bits that half precision keeps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..contract import Dataset, Frame, load_passes, rain
from .exact import Light

THINNEST = 0.05  # share of light that drops leave; behind more of them nothing is recovered


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
