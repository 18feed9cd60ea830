"""The rain of a frame: the same drops whatever the paint, for the data set and for camouflages rendered later."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core import contract, seeding
from .session import Session


def rain_before(
    session: Session, location: int, view: int, weather: contract.Weather, distance: NDArray[np.floating]
) -> contract.rain.Streaks | None:
    """What falls between the camera and the scene; None in dry weather.

    Args:
        distance: (H, W) metres along the view ray as the frame stores them (half precision), infinity for sky.
    """
    if weather.precipitation == 0.0:
        return None
    seed = seeding.named_seed(session.plan.seed, "rain", location, view, weather.name)
    return contract.rain.streaks(weather, session.viewpoint(location, view).camera, distance.astype(np.float16), seed)
