"""What W of Eq. 5 is good for: the same training with and without it, near and far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rauca_core.contract.color import TEST
from rauca_core.environment import LightSplitter
from rauca_core.environment.frames import LightFrames
from rauca_core.environment.methods import splitter_render
from rauca_core.environment.metrics import measure, total

from .settings import Settings


@dataclass(frozen=True)
class Weighting:
    """PSNR in 32 colors against exact maps, by distance in metres: {distance: (with W, without)}."""

    by_distance: dict[float, tuple[float, float]]

    def to_json(self) -> dict[str, dict[str, float]]:
        return {
            f"{distance:g} m": {"with_w_db": round(a, 3), "without_w_db": round(b, 3)}
            for distance, (a, b) in self.by_distance.items()
        }


def weigh(
    frames: LightFrames, test_on: Sequence[int], nets: tuple[LightSplitter, LightSplitter], settings: Settings
) -> Weighting:
    """Measure two trained networks on near frames and on far ones; the cut lies halfway."""
    low, high = settings.distances_m
    parts = {distance: [i for i in test_on if _nearest(frames, i, low, high) == distance] for distance in (low, high)}
    found = {}
    for distance, part in parts.items():
        first, second = (_db(net, frames, part) for net in nets)
        found[distance] = (first, second)
    return Weighting(found)


def _nearest(frames: LightFrames, index: int, *distances: float) -> float:
    away = frames.places[index].frame.distance_m
    return min(distances, key=lambda distance: abs(distance - away))


def _db(net: LightSplitter, frames: LightFrames, part: Sequence[int]) -> float:
    return total(measure(frames, part, lambda i, frame: splitter_render(net, frame), TEST).values()).psnr_db
