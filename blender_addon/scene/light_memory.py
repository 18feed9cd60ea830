"""Light that later frames of a camera ask for again: nights that are alike, and the clear view under composed fog."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import contract
from .composed_fog import is_composed

MOST_BYTES = 256 << 20  # about a hundred views of 320 x 320


class PaintLight(NamedTuple):
    """Radiance of a view, (H, W, 3) linear each: what paint of albedo one adds, and what is there with black paint."""

    gain: NDArray[np.float32]
    black: NDArray[np.float32]


class LightMemory:
    """Renders of one location and one light, with and without fog: frames come in that order.

    Another location or light empties it, so that memory stays flat. It only saves time: what is asked for again and
    gone is rendered again, to the same bytes, as seeds depend on the light and not on the weather's name.
    """

    def __init__(self, plan: contract.Plan) -> None:
        self._kept: dict[tuple[float, ...], PaintLight] = {}
        self._present: tuple[float, ...] = ()
        self._wanted = _wanted_again(plan.weathers, plan.quality) if plan.light else set()

    def get(self, location: int, view: int, weather: contract.Weather) -> PaintLight | None:
        """The light kept for a camera and a weather, if any."""
        return self._kept.get((location, view, *weather.light_key()))

    def keep(self, location: int, view: int, weather: contract.Weather, light: PaintLight) -> None:
        """Keep it if another weather of the plan will want it."""
        if weather.light_key() not in self._wanted:
            return
        present = (location, *clear(weather).light_key())
        if present != self._present:
            self._kept.clear()
            self._present = present
        if (len(self._kept) + 1) * (light.gain.nbytes + light.black.nbytes) <= MOST_BYTES:
            self._kept[(location, view, *weather.light_key())] = light


def clear(weather: contract.Weather) -> contract.Weather:
    """The same light without fog."""
    return replace(weather, fog_density=0.0)


def _wanted_again(weathers: Sequence[contract.Weather], quality: contract.Quality) -> set[tuple[float, ...]]:
    """Lights that two weathers share, or that fog is composed on."""
    keys = [weather.light_key() for weather in weathers]
    shared = {key for key in keys if keys.count(key) > 1}
    return shared | {clear(weather).light_key() for weather in weathers if is_composed(quality, weather)}
