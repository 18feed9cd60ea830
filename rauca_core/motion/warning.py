"""What an engineer reads of a clip: how late a car is known, how long it is gone, whether one could still brake.

A car counts as known where a confirmed track has it. Distances are those of the camera from the car's middle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .metrics import Followed

BRAKING_M_S2 = 7.0  # of a car on dry asphalt; an emergency brake reaches 8 to 10
REACTION_S = 0.5  # of an automatic brake, from the warning to full pressure


@dataclass(frozen=True, eq=False)
class Drive:
    """How a clip was driven.

    Attributes:
        times_s: (F,) of the frames, rising.
        distances_m: (F,) camera to the car's middle.
    """

    times_s: NDArray[np.float64]
    distances_m: NDArray[np.float64]

    @property
    def closing_m_s(self) -> NDArray[np.float64]:
        """(F,) speed at which the gap closes; negative where it grows."""
        return np.asarray(-np.gradient(self.distances_m, self.times_s))

    @property
    def frame_s(self) -> float:
        """Seconds that a frame stands for."""
        return float(np.median(np.diff(self.times_s)))


@dataclass(frozen=True)
class Figures:
    """Of one clip, one paint and one detector.

    Attributes:
        late_s: from the car's first appearance to its first track; to the end of the clip if there never is one.
        late_m: by how much the gap closed meanwhile.
        gap_s: the longest time in which the car is there and no track has it.
        blind: share of the frames within braking distance, while the gap closes, without a track; None where no frame
            is that close.
        breaks, switches: how often the track is lost and found again, and replaced by another.
        hota: of the car alone, in [0, 1].
    """

    late_s: float
    late_m: float
    gap_s: float
    blind: float | None
    breaks: int
    switches: int
    hota: float


def figures(drive: Drive, car: Followed, hota: float) -> Figures:
    """Read a clip's figures off the car's way through it; the car is seen in at least one frame."""
    seen = np.flatnonzero(car.seen)
    first, last = int(seen[0]), len(car.seen) - 1
    tracked = np.flatnonzero(car.track > 0)
    known = int(tracked[0]) if tracked.size else last
    closed = np.clip(-np.diff(drive.distances_m[first : known + 1]), 0.0, None)
    return Figures(
        late_s=float(drive.times_s[known] - drive.times_s[first]),
        late_m=float(closed.sum()),
        gap_s=_longest(car.seen & (car.track == 0)) * drive.frame_s,
        blind=_blind(drive, car),
        breaks=car.breaks,
        switches=car.switches,
        hota=hota,
    )


def braking_m(speed_m_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Metres that a car drives until it stands, the reaction included; none for a gap that grows."""
    closing = np.clip(speed_m_s, 0.0, None)
    return np.asarray(closing * REACTION_S + closing**2 / (2 * BRAKING_M_S2))


def _blind(drive: Drive, car: Followed) -> float | None:
    within = car.seen & (drive.closing_m_s > 0) & (drive.distances_m <= braking_m(drive.closing_m_s))
    return float((car.track[within] == 0).mean()) if within.any() else None


def _longest(flags: NDArray[np.bool_]) -> int:
    """Length of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))
