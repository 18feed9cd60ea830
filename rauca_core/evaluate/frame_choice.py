"""Which frames stand for all in the report's pictures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .results import FrameRow

COLUMNS = 6


def chosen_frames(frames: Sequence[FrameRow]) -> list[int]:
    """Indices of up to six frames that show the variety.

    Views spread around the ring in the first weather, at one elevation and distance; then one view in up to three other
    weathers.
    """
    weathers = list(dict.fromkeys(row.weather for row in frames))
    others = weathers[1 : 1 + COLUMNS // 2]
    ring = _ring([i for i, row in enumerate(frames) if row.weather == weathers[0]], frames)
    count = min(len(ring), COLUMNS - len(others))
    chosen = [ring[round(k)] for k in np.linspace(0, len(ring), count, endpoint=False)]
    model = frames[chosen[min(1, count - 1)]]
    for weather in others:
        alike = [i for i, row in enumerate(frames) if row.weather == weather]
        chosen.append(min(alike, key=lambda i: _difference(frames[i], model)))
    return chosen


def _ring(indices: list[int], frames: Sequence[FrameRow]) -> list[int]:
    """The frames that share the elevation and distance of the first, by azimuth."""
    first = frames[indices[0]]
    same = [
        i for i in indices if (frames[i].elevation_deg, frames[i].distance_m) == (first.elevation_deg, first.distance_m)
    ]
    return sorted(same, key=lambda i: frames[i].azimuth_deg)


def _difference(a: FrameRow, b: FrameRow) -> float:
    turned = abs(a.azimuth_deg - b.azimuth_deg) % 360
    return min(turned, 360 - turned) + abs(a.elevation_deg - b.elevation_deg) + 10 * abs(a.distance_m - b.distance_m)
