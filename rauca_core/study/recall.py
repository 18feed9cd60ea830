"""Where a detector finds its target at the deployed score: along the distance, and from every side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .intervals import Places, share_interval
from .results import FrameRow

SIDES = ("front", "front left", "left", "rear left", "rear", "rear right", "right", "front right")
_BANDS = 4  # of distances, at most: with more of them a cell holds too few views


@dataclass(frozen=True)
class Recall:
    """Share of some views in which the target is found; ``low`` and ``high`` are its 95 % interval over places."""

    share: float
    low: float
    high: float
    views: int


@dataclass(frozen=True, eq=False)
class Around:
    """Views by side and distance.

    Attributes:
        sides: columns, of :data:`SIDES`.
        bands: rows, such as ``5-6 m``.
        found, views: (bands, sides) in how many of how many views the target is found.
    """

    sides: tuple[str, ...]
    bands: tuple[str, ...]
    found: NDArray[np.int64]
    views: NDArray[np.int64]


def side_of(azimuth_deg: float) -> str:
    """From where a camera sees the vehicle, to the nearest 45 degrees; 0 is its front, 90 its left."""
    return SIDES[_sector(azimuth_deg)]


def along_distance(rows: Sequence[FrameRow], hits: NDArray[np.float64], places: Places) -> dict[float, Recall]:
    """Recall at each nominal distance of the cameras.

    Args:
        rows: the frames.
        hits: (F,) share of the paints in which each frame's target is found.
        places: of the frames.
    """
    distances = np.array([row.distance_m for row in rows])
    return {float(value): _recall(hits, np.flatnonzero(distances == value), places) for value in np.unique(distances)}


def _recall(hits: NDArray[np.float64], chosen: NDArray[np.int64], places: Places) -> Recall:
    some = Places.of(places.of_frame[chosen].tolist(), chosen.tolist())
    counts = some.left_out()[:, some.of_frame].astype(np.float64)
    shares = counts @ hits[chosen] / counts.sum(1)
    return Recall(float(shares[0]), *share_interval(shares, len(chosen)), len(chosen))


def around(rows: Sequence[FrameRow], found: NDArray[np.bool_]) -> Around:
    """How often the target is found from each side at each distance, neighbouring distances taken together.

    Args:
        rows: the frames.
        found: (F,) whether the target is found in each.
    """
    distances, at = np.unique([row.distance_m for row in rows], return_inverse=True)
    parts = np.array_split(np.arange(len(distances)), min(_BANDS, len(distances)))
    band = np.concatenate([np.full(len(part), number) for number, part in enumerate(parts)])[at]
    sectors, side = np.unique([_sector(row.azimuth_deg) for row in rows], return_inverse=True)
    shape = len(parts), len(sectors)
    cell = band * len(sectors) + side
    views, seen = (np.bincount(cell, weight, minlength=shape[0] * shape[1]) for weight in (None, found))
    ends = [(distances[part[0]], distances[part[-1]]) for part in parts]
    names = tuple(f"{near:g} m" if near == far else f"{near:g}-{far:g} m" for near, far in ends)
    return Around(
        tuple(SIDES[sector] for sector in sectors), names, seen.reshape(shape).astype(np.int64), views.reshape(shape)
    )


def _sector(azimuth_deg: float) -> int:
    return round(azimuth_deg / 45) % len(SIDES)
