"""What stands along the street: lamps, small things, and parked vehicles, which are objects of their own in masks."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..massing import MeshParts, pick, shifted, turned
from .site import Site
from .tables import FURNITURE, PARKED, Parked

# Corners of a sign's plate, its rim and its face.
SIGNS = (
    (16, "sign red", "sign white"),
    (16, "sign blue", "sign blue"),
    (3, "sign red", "sign white"),
    (4, "sign white", "sign blue"),
    (8, "sign white", "sign red"),
)


def build_furniture(site: Site) -> None:
    """Lamps first: the rest makes room for them."""
    _lamps(site)
    district = site.layout.district
    rng = site.layout.rng("furniture")
    if not district.furniture:
        return
    for side in (-1, 1):
        along = -55.0
        while along < 55.0:
            along += rng.uniform(3.0, 11.0)
            _stand(site, rng, pick(rng, district.furniture), along, side)


def _stand(site: Site, rng: np.random.Generator, name: str, along: float, side: int) -> None:
    model, district = FURNITURE[name], site.layout.district
    wide = district.pavement_m or 2.0
    aside = district.road_half_m + {"kerb": 0.45, "wall": wide * 0.8, "middle": wide * 0.5}[model.where]
    for at in (along + i * 2.2 for i in range(model.run)):
        frame = site.frame(at, side * aside, 0.0 if side > 0 else math.pi)
        if site.clear_of_crossing(at, 1.0) and site.claim(frame, model.room_m):
            with site.parts.at(frame):
                PROCEDURAL.get(name, model.build)(site.parts, rng)


def _lamps(site: Site) -> None:
    """Lamp posts in turn on both sides, their heads over the road."""
    district, height = site.layout.district, site.layout.district.lamp_height_m
    post = "cast iron" if height < 5 else "galvanised"
    reach = 0.0 if height < 5 else min(2.2, 0.25 * height)
    rng = site.layout.rng("lamps")
    first = rng.uniform(-7, 7)  # one lamp lights the vehicle's neighborhood
    count = int(62.0 / district.lamp_every_m)
    for i in range(-count, count + 1):
        side = 1 if i % 2 else -1
        along = float(first + i * district.lamp_every_m + rng.uniform(-1, 1))
        aside = side * (district.road_half_m + 0.6)
        frame = site.frame(along, aside, math.pi / 2 * side)  # local x points away from the road on either side
        if not site.clear_of_crossing(along, 1.0) or not site.claim(frame, 0.3):
            continue
        parts = site.parts
        with parts.at(frame):
            parts.column(post, (0, 0, 0), 0.10, 0.9, 8)
            parts.column(post, (0, 0, 0.9), 0.07, height - 0.9, 8, 0.7)
            if reach:
                parts.beam(post, (0, 0, height - 0.1), (-reach, 0, height + 0.12), 0.045)
                parts.box(post, (-reach - 0.55, -0.14, height + 0.06), (-reach + 0.1, 0.14, height + 0.18))
                parts.box("lamp head", (-reach - 0.5, -0.11, height + 0.03), (-reach, 0.11, height + 0.065))
            else:
                parts.column("lamp head", (0, 0, height), 0.13, 0.34, 6, 1.35)
                parts.column(post, (0, 0, height + 0.34), 0.24, 0.16, 6, 0.2)
        light = frame @ turned(0.0, -reach - 0.25 if reach else 0.0, 0.0, height - 0.04)
        site.lamps.append(light)


def _sign(parts: MeshParts, rng: np.random.Generator) -> None:
    """A traffic sign that looks along the street: round, square or a triangle."""
    parts.column("galvanised", (0, 0, 0), 0.035, 2.75, 6)
    sides, rim, face = SIGNS[int(rng.integers(len(SIGNS)))]
    angles = np.arange(sides) * 2 * math.pi / sides + (math.pi / 2 if sides == 3 else math.pi / sides)
    forward = 1.0 if rng.random() < 0.5 else -1.0
    for radius, depth, material in ((0.36, 0.045, rim), (0.27, 0.055, face)):
        x = np.full(sides, forward * depth)
        points = np.stack([x, radius * np.cos(angles), 2.35 + radius * np.sin(angles)], axis=1)
        back = points - [forward * 0.02, 0, 0]
        parts.polygons(material, points, [np.arange(sides)])
        parts.polygons("galvanised", back, [np.arange(sides)])


def _planter(parts: MeshParts, rng: np.random.Generator) -> None:
    parts.box("planter", (-0.8, -0.4, 0.0), (0.8, 0.4, 0.55))
    centers = np.stack([rng.uniform(-0.7, 0.7, 26), rng.uniform(-0.3, 0.3, 26), rng.uniform(0.5, 0.95, 26)], axis=1)
    for center in centers:
        parts.beam("hedge", center - [0, 0, 0.2], center + rng.uniform(-0.2, 0.2, 3), 0.14, 4, 0.2)


def _pallet(parts: MeshParts, rng: np.random.Generator) -> None:
    for i in range(int(rng.integers(1, 8))):
        x = np.linspace(-0.55, 0.45, 5)[:, None] * [1, 0, 0] + [0, 0, 0.15 * i]
        parts.boxes("wood", shifted(x, 0, -0.4, 0.11), shifted(x, 0.12, 0.4, 0.14))
        parts.boxes("wood", np.array([[-0.6, y, 0.15 * i] for y in (-0.4, -0.05, 0.3)]),
                    np.array([[0.6, y + 0.1, 0.15 * i + 0.11] for y in (-0.4, -0.05, 0.3)]))  # fmt: skip


PROCEDURAL = {"sign": _sign, "planter": _planter, "pallet": _pallet}


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
