"""The data sets that variants are optimized on, as many frames of each, so that only what they show differs.

All stand in one town, which is not the held-out one, and see the vehicle from the directions that it is measured from.
As in the paper, ``single`` and ``base`` see it from fixed points in clearcoat paint, and ``enhanced`` from points that
move, in the paint that it is measured in.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...contract import Plan, Quality, RaucaError, Ring, balanced_frames, find_preset
from ...contract.assets import assets_folder
from ..views import RING, HeldOut
from .experiment import Sizes

TOWN_SEED = 1
LOCATIONS = 8
_STILL = replace(RING, jitter_azimuth_deg=0.0, jitter_elevation_deg=0.0, jitter_distance=0.0, jitter_aim_m=0.0)


@dataclass(frozen=True)
class TrainingSet:
    """Which weathers, cameras and finish of the paint; ``name`` is that of the weathers' preset."""

    name: str
    ring: Ring
    finish: str

    def plan(self, vehicle_name: str, atlas_id: str, positions: NDArray[np.float32], sizes: Sizes) -> Plan:
        """All combinations, of which :func:`chosen_frames` takes a part; large vehicles are seen from farther away.

        Args:
            positions: (V, 3) the vehicle's vertices, metres, z up.
        """
        weathers = tuple(find_preset(self.name, assets_folder() / "weathers"))
        ring = HeldOut(ring=self.ring).fitted(positions).ring
        return Plan(
            self.name, vehicle_name, atlas_id, sizes.pixels, Quality(sizes.samples), True, weathers, ring, LOCATIONS,
            (140, 140, 140), 0.5, TOWN_SEED, "", finish=self.finish,
        )  # fmt: skip


TRAINING_SETS = {
    found.name: found
    for found in (
        TrainingSet("single", _STILL, "car_paint"),
        TrainingSet("base", _STILL, "car_paint"),
        TrainingSet("enhanced", RING, "own"),
    )
}


def training_set(name: str) -> TrainingSet:
    """The training set of that name; raises :class:`RaucaError` listing all when there is none."""
    if name not in TRAINING_SETS:
        raise RaucaError(f"training set: no {name!r}; choose one of {', '.join(TRAINING_SETS)}")
    return TRAINING_SETS[name]


def chosen_frames(plan: Plan, sizes: Sizes, share: float = 1.0) -> list[str]:
    """Ids of a balanced part of a plan, in its order; a smaller ``share`` is a part of a larger one."""
    return balanced_frames(plan, max(1, round(share * sizes.frames)))
