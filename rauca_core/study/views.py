"""Held-out views: a camera ring in a town of its own, of which a balanced part is rendered.

The plan is as large as the published ones: 8 azimuths, 4 elevations and 4 distances in 16 weathers, at 8 locations,
16,384 frames. A larger part contains the smaller one, so that a study can grow.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..contract import (
    MIN_VISIBLE,
    Clips,
    Plan,
    Quality,
    RaucaError,
    Ring,
    Scenery,
    Weather,
    balanced_frames,
    find_preset,
    load_vehicle,
    preset_notes,
)
from ..contract.towns import TEST
from ..runtime.images import read_image
from . import recipes
from .artifact import Artifact
from .candidates import VehicleChoice

LOG = logging.getLogger(__name__)

PRESETS = {"seen": "enhanced", "unseen": "unseen"}  # the paper's weathers of training, and 16 others
SCALES = {"quick": 32, "standard": 128, "full": 1024}  # frames per weather set
_AZIMUTHS = tuple(45.0 * step for step in range(8))
_JITTER = {"jitter_azimuth_deg": 15.0, "jitter_elevation_deg": 5.0, "jitter_distance": 0.1, "jitter_aim_m": 0.3}
# What people, cars, houses and lamp posts see; and the published ring. From 45 degrees up, small detectors barely find
# the plain car (AP 0.37, and 0.21 at 67.5 degrees): a camouflage has little left to hide there.
RINGS = {
    "street": Ring(_AZIMUTHS, (0.0, 8.0, 16.0, 24.0), (5.0, 8.0, 12.0, 16.0), **_JITTER),
    "paper": Ring(_AZIMUTHS, (0.0, 22.5, 45.0, 67.5), (5.0, 10.0, 15.0, 20.0), **_JITTER),
}
RING = RINGS["street"]
REACH_M = 3.5  # from a vehicle's center to its corner; what reaches farther is seen from farther away


@dataclass(frozen=True)
class HeldOut:
    """How held-out views are made.

    Attributes:
        frames: rendered per weather set.
        size: frames are square, pixels.
        samples: per pixel.
        seed: of the town and its cameras; a test town unless another is asked for, see `contract.towns`.
        fit: see large vehicles from farther away, see :meth:`fitted`.
        clips: what is driven at one place instead of standing still; ``frames`` and ``ring`` say nothing then.
    """

    frames: int = SCALES["standard"]
    ring: Ring = RING
    locations: int = 8
    size: int = 320
    samples: int = 8
    seed: int = TEST["held-out views"]
    fit: bool = True
    clips: Clips | None = None

    @staticmethod
    def driven(clips: Clips, size: int, samples: int, seed: int | None = None) -> HeldOut:
        """Clips at one place of a test town in which all ways are free at the usual speeds."""
        town = TEST["held-out clips"] if seed is None else seed
        return HeldOut(locations=1, size=size, samples=samples, seed=town, clips=clips)

    def one_a_place(self, places: int, town: int) -> HeldOut:
        """The same, but a single view in each of so many places of a town."""
        return replace(self, frames=places, locations=places, seed=town)

    def fitted(self, positions: NDArray[np.float32]) -> HeldOut:
        """The same views of a vehicle larger than a car, from as many times farther (whole metres).

        Args:
            positions: (V, 3) the vehicle's vertices, metres, z up.
        """
        if self.clips is not None:
            return self
        reach = float(np.linalg.norm(np.ptp(positions[:, :2], axis=0)) / 2)
        if not self.fit or reach <= REACH_M:
            return self
        farther = tuple(float(round(distance * reach / REACH_M)) for distance in self.ring.distances_m)
        return replace(self, ring=replace(self.ring, distances_m=farther))

    def plan(self, vehicle_name: str, atlas_id: str, weathers: Sequence[Weather]) -> Plan:
        """The whole plan, of which :func:`rauca_core.contract.balanced_frames` chooses.

        Fog is rendered, not composed: every paint is judged by the same renderer.
        """
        return Plan.of(
            weathers, self.ring, name="views", vehicle_name=vehicle_name, atlas_id=atlas_id, size=self.size,
            quality=Quality(self.samples, composed_fog=False), light=False, locations=self.locations, seed=self.seed,
            clips=self.clips, min_visible=MIN_VISIBLE if self.clips is None else 0.0,
        )  # fmt: skip


def weather_views(
    vehicle: VehicleChoice, sets: Mapping[str, Sequence[Weather]], made: HeldOut, scene: Path | None = None
) -> dict[str, Artifact]:
    """Views of a vehicle in its reference paint, to be rendered, of each set of weathers by its name.

    Args:
        scene: the .blend that it stands in, if that is not the town.
    """
    body, views = recipes.vehicle_in(vehicle.folder), {}
    fitted = made.fitted(load_vehicle(vehicle.folder, read_image).positions)
    for called, weathers in sets.items():
        plan = fitted.plan(vehicle.name, vehicle.atlas_id, weathers)
        plan = plan if scene is None else replace(plan, scenery=Scenery.of_file(scene))
        frames = [frame.id for frame in plan.frames()] if plan.clips else balanced_frames(plan, fitted.frames)
        views[called] = recipes.data_set(f"{vehicle.name}-{called}", plan, body, frames, scene)
    return views


def weather_sets(names: Sequence[str]) -> list[str]:
    """Weathers of held-out views, each once and with a file name of its own; their folders are called by it.

    Args:
        names: ``seen``, ``unseen``, ``both``, or presets by name or file.

    Raises:
        RaucaError: an unknown preset, or two of one name.
    """
    chosen = [part for name in names for part in (("seen", "unseen") if name == "both" else (name,))]
    called: dict[str, str] = {}
    for name in chosen:
        weathers_named(name)
        if (other := called.setdefault(Path(name).stem, name)) != name:
            raise RaucaError(f"--weathers {name}: has the name of {other}; results are told apart by it, rename one")
    return list(called.values())


def weathers_named(name: str) -> tuple[Weather, ...]:
    """The weathers of a set; raises :class:`RaucaError` listing all presets when there is none of that name."""
    preset = PRESETS.get(name, name)
    for note in preset_notes(preset):
        LOG.warning("note: %s", note)
    return tuple(find_preset(preset))
