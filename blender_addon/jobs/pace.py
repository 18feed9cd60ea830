"""How long a job still takes, from the pace of its latest frames."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

REMEMBERED = 64


class Pace:
    """Times of the latest frames; starts when made, so the first estimate includes what it took to get going."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._times: deque[float] = deque([clock()], maxlen=REMEMBERED)

    def step(self) -> None:
        """A frame was rendered."""
        self._times.append(self._clock())

    def left_s(self, frames: int) -> float | None:
        """Seconds that ``frames`` more will take; None before the first."""
        if len(self._times) < 2:
            return None
        return frames * (self._times[-1] - self._times[0]) / (len(self._times) - 1)


def spoken(seconds: float) -> str:
    """A duration for people: ``45 s``, ``12 min``, ``3 h 20 min``."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
