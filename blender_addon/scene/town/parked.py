"""Parked vehicles of other classes: each an object of its own, so that masks and boxes tell them apart."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..massing import MeshParts
from .site import Site
from .tables import PARKED, Parked

MODELS = {
    "truck": ("truck", "truck", "tipper"),
    "bus": ("bus",),
    "motorcycle": ("motorcycle",),
    "bicycle": ("bicycle",),
}
LARGE = ("truck", "bus")
LARGE_ROOM_M = 10.5  # from the vehicle's middle: nearer, they would stand where the cameras do
SMALL_ROOM_M = 4.6
SPREAD_M = 42.0
TRIES = 12


def build_parked(site: Site) -> list[tuple[str, MeshParts, NDArray[np.float64]]]:
    """(COCO class, mesh, district frame) of each vehicle parked along the street."""
    district, rng = site.layout.district, site.layout.rng("parked")
    wanted = [district.parked[i] for i in rng.integers(0, len(district.parked), int(rng.integers(3, 7)))]
    parked = []
    for category in sorted(wanted, key=lambda name: name not in LARGE):  # the large ones first: they need the room
        model = PARKED[MODELS[category][int(rng.integers(len(MODELS[category])))]]
        for _ in range(TRIES):
            frame = _spot(site, rng, category, model)
            least = LARGE_ROOM_M if category in LARGE else SMALL_ROOM_M + model.length_m / 2
            if site.layout.from_vehicle(frame[:3, 3]) < least:
                continue
            crossed = not site.clear_of_crossing(float(frame[0, 3]), model.length_m / 2 + 4.0)
            if not crossed and site.claim(frame, model.width_m / 2 + 0.1, model.length_m):
                parts = MeshParts()
                model.build(parts, rng)
                if category == "bicycle" and rng.random() < 0.5:
                    parts.box("plastic trim", (0.42, -0.18, 0.8), (0.72, 0.18, 1.02))  # a basket
                parked.append((category, parts, frame))
                break
    return parked


def _spot(site: Site, rng: np.random.Generator, category: str, model: Parked) -> NDArray[np.float64]:
    """Somewhere along the kerb for large ones, on the pavement for small ones."""
    district = site.layout.district
    side = int(rng.choice((-1, 1)))
    along = float(rng.uniform(-SPREAD_M, SPREAD_M))
    turn = 0.0 if side < 0 else math.pi
    if category in LARGE:
        aside = district.road_half_m - model.width_m / 2 - 0.1
        if district.road_half_m >= 9:  # a yard: square to the road, in its bays or at the halls' doors
            aside = rng.uniform(9.5, district.front_m[0] - 1.0 - model.length_m / 2)
            return site.frame(along, side * aside, turn + math.pi / 2 * rng.choice((-1, 1)))
        if district.lines == "country":
            aside = district.road_half_m + model.width_m / 2 + 0.4
        return site.frame(along, side * aside, turn + math.radians(rng.uniform(-1.5, 1.5)))
    wide = max(district.pavement_m, 1.4)
    lean = rng.uniform(-0.3, 0.3) if category == "bicycle" else math.pi / 2 + rng.uniform(-0.5, 0.2)
    if category == "motorcycle":
        return site.frame(along, side * (district.road_half_m - 0.75), turn + lean * 0.7)
    return site.frame(along, side * (district.road_half_m + wide * 0.55), turn + lean)
