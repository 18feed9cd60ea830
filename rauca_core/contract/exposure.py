"""How bright a frame is: the camera opens up in a street's shade, as the weather's exposure suits open ground.

What is metered does not hold the vehicle: every paint gets the same exposure.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .semantics import CLASS_IDS, TARGET_INSTANCE

TARGET = 0.07  # median radiance, display white 1, of streets in the open: asphalt and walls under a sun at 45 degrees
COMPENSATED = 0.75  # of what is missing in stops: shade stays darker than sun
MOST_STOPS = 2.5
LEAST_SHARE = 0.05  # of the frame must be metered
DARK_ALTITUDE_DEG = -6.0  # the sun at which nothing is compensated: nights are to stay dark
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)


def metered_stops(
    image_linear: NDArray[np.float32],
    semantic: NDArray[np.uint8],
    instances: NDArray[np.uint8],
    sun_altitude_deg: float,
) -> float:
    """Powers of two by which a frame is brightened, from 0 to :data:`MOST_STOPS`.

    Args:
        image_linear: (H, W, 3) as the weather exposes it.
        semantic, instances: (H, W) ids; sky and the data set's vehicle are not metered.
        sun_altitude_deg: of the weather; below the horizon compensation fades.
    """
    metered = (semantic != CLASS_IDS["sky"]) & (instances != TARGET_INSTANCE)
    if metered.mean() < LEAST_SHARE:
        return 0.0
    median = float(np.median((image_linear.reshape(-1, 3) @ LUMINANCE)[metered.ravel()]))
    missing = COMPENSATED * np.log2(TARGET / max(median, 1e-6))
    by_day = np.clip(1.0 - sun_altitude_deg / DARK_ALTITUDE_DEG, 0.0, 1.0)
    return round(float(by_day * np.clip(missing, 0.0, MOST_STOPS)), 3)
