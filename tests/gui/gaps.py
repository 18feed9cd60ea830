"""How long the window stays deaf while something runs, and whose fault it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

DEAF_S = 0.1


@dataclass(frozen=True)
class Gaps:
    """Times between two turns of Blender's event loop, and of the add-on's own code inside them; seconds.

    Attributes:
        wall: as a user with this machine, under its load, meets them.
        busy: the same less the waiting for a core: what they were if nothing else ran here. Drawing by software counts.
        own: every call of the add-on's timer, panels and modal operators, less the waiting for a core.
        slowest: the name of the slowest of those.
    """

    wall: Sequence[float]
    busy: Sequence[float]
    own: Sequence[float]
    slowest: str

    @staticmethod
    def of(taken: dict[str, Any]) -> Gaps:
        """From what the probe noted."""
        gaps = np.array(taken["gaps"]).reshape(-1, 3)
        calls = taken["own"]
        own = [wall - waited for _, wall, waited in calls]
        slowest = calls[int(np.argmax(own))][0] if calls else ""
        return Gaps(gaps[:, 0].tolist(), (gaps[:, 0] - gaps[:, 2]).tolist(), own, slowest)

    def __str__(self) -> str:
        return (
            f"{len(self.wall)} turns in {sum(self.wall):.0f} s; wall {_figures(self.wall)}; less waiting for a core "
            f"{_figures(self.busy)}; the add-on's own code {_figures(self.own)}, slowest {self.slowest}"
        )


def percentile(values: Sequence[float], share: float) -> float:
    return float(np.percentile(values, share)) if len(values) else 0.0


def _figures(values: Sequence[float]) -> str:
    steps = {f"p{share}": percentile(values, share) for share in (50, 95, 99)}
    steps["max"] = max(values, default=0.0)
    over = sum(value > DEAF_S for value in values)
    return " ".join(f"{name} {1e3 * value:.1f}" for name, value in steps.items()) + f" ms ({over} over 100 ms)"
