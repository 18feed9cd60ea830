"""Falling rain as a picture to lay over the viewport. NumPy only.

The drops are drawn by the code that draws them into the data set's frames, for a camera of the viewport's kind; only
what stands before them is not known here, so they fall before everything.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core import contract, seeding

HEIGHT = 360  # pixels; enlarged to the viewport's
FOV_DEG = 60.0
DISTANCE_M = 12.0  # of everything, for the haze that distant drops make
LOOKING_DOWN_M = 0.3  # at that distance


def rain_picture(weather: contract.Weather, aspect: float) -> NDArray[np.float32] | None:
    """The rain before a view, (H, W, 4) linear, display-referred RGBA, not premultiplied; None in dry weather.

    Args:
        aspect: width over height of the view.
    """
    if weather.precipitation == 0.0:
        return None
    width = max(1, round(HEIGHT * aspect))
    eye, target = np.array([0.0, 0.0, 1.5]), np.array([DISTANCE_M, 0.0, 1.5 - LOOKING_DOWN_M])
    camera = contract.Camera.look_at(eye, target, FOV_DEG, width, HEIGHT)
    distance = np.full((HEIGHT, width), DISTANCE_M, np.float32)
    rain = contract.rain.streaks(weather, camera, distance, seeding.named_seed("viewport"))
    picture = np.empty((HEIGHT, width, 4), np.float32)
    picture[..., :3], picture[..., 3] = rain.radiance, rain.alpha
    return picture
