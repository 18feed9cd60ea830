"""Small things along the street: lamps, signs, benches, bins, bollards, fences."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..massing import MeshParts, pick, shifted, turned
from .site import Site

# Corners of a sign's plate, its rim and its face.
SIGNS = (
    (16, "sign red", "sign white"),
    (16, "sign blue", "sign blue"),
    (3, "sign red", "sign white"),
    (4, "sign white", "sign blue"),
    (8, "sign white", "sign red"),
)

Maker = Callable[[MeshParts, np.random.Generator], None]


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
    make, room, spread, run = FURNITURE[name]
    district = site.layout.district
    wide = district.pavement_m or 2.0
    aside = district.road_half_m + (0.45 if spread == "kerb" else wide * 0.8 if spread == "wall" else wide * 0.5)
    spin = 0.0 if side > 0 else math.pi
    for i in range(run):
        at = along + i * 2.2
        if site.clear_of_crossing(at, 1.0):
            frame = site.frame(at, side * aside, spin)
            if site.claim(frame, room):
                with site.parts.at(frame):
                    make(site.parts, rng)


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


def _bollard(parts: MeshParts, rng: np.random.Generator) -> None:
    parts.column("cast iron", (0, 0, 0), 0.07, 0.85, 8)
    parts.column("cast iron", (0, 0, 0.85), 0.09, 0.09, 8, 0.5)
    parts.column("sign white", (0, 0, 0.68), 0.074, 0.09, 8)


def _bench(parts: MeshParts, rng: np.random.Generator) -> None:
    for x in (-0.75, 0.7):
        parts.box("cast iron", (x, -0.05, 0.0), (x + 0.06, 0.42, 0.42))
        parts.box("cast iron", (x, 0.38, 0.42), (x + 0.06, 0.44, 0.85))
    y = np.array([0.0, 0.13, 0.26])[:, None] * [0.0, 1.0, 0.0]
    parts.boxes("wood", shifted(y, -0.9, -0.04, 0.42), shifted(y, 0.9, 0.06, 0.46))
    z = np.array([0.55, 0.70])[:, None] * [0.0, 0.0, 1.0]
    parts.boxes("wood", shifted(z, -0.9, 0.36, 0.0), shifted(z, 0.9, 0.39, 0.11))


def _bin(parts: MeshParts, rng: np.random.Generator) -> None:
    material = pick(rng, ("plastic green", "plastic black", "galvanised"))
    parts.column(material, (0, 0, 0.06), 0.24, 0.8, 9, 1.15)
    parts.column("plastic black", (0, 0, 0.86), 0.29, 0.08, 9, 0.7)


def _wheelie(parts: MeshParts, rng: np.random.Generator) -> None:
    material = pick(rng, ("plastic green", "plastic black", "sign blue"))
    parts.extrusion(material, [(-0.27, 0.08), (0.25, 0.08), (0.31, 1.0), (-0.33, 0.95)], -0.27, 0.27)
    parts.extrusion("plastic black", [(-0.36, 0.95), (0.35, 1.0), (0.3, 1.06), (-0.36, 1.03)], -0.29, 0.29)


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


def _bicycle_stand(parts: MeshParts, rng: np.random.Generator) -> None:
    for x in (0.0, 0.8):
        parts.beam("galvanised", (x, -0.35, 0), (x, -0.35, 0.8), 0.03)
        parts.beam("galvanised", (x, 0.35, 0), (x, 0.35, 0.8), 0.03)
        parts.beam("galvanised", (x, -0.36, 0.8), (x, 0.36, 0.8), 0.03)


def _shelter(parts: MeshParts, rng: np.random.Generator) -> None:
    """A bus shelter: a roof on posts, a bench, a poster."""
    for x in (-1.8, 0.0, 1.8):
        parts.box("galvanised", (x - 0.04, 0.55, 0.0), (x + 0.04, 0.63, 2.4))
    parts.box("trim dark", (-2.0, -0.7, 2.4), (2.0, 0.75, 2.52))
    parts.box("sign white", (1.7, -0.5, 0.5), (1.78, 0.5, 2.1))
    parts.box("wood", (-1.5, 0.2, 0.45), (1.2, 0.5, 0.5))
    parts.box("planter", (-1.4, 0.3, 0.0), (-1.3, 0.4, 0.45))


def _hydrant(parts: MeshParts, rng: np.random.Generator) -> None:
    parts.column("post red", (0, 0, 0), 0.12, 0.6, 8)
    parts.column("post red", (0, 0, 0.6), 0.15, 0.16, 8, 0.4)
    parts.beam("post red", (-0.2, 0, 0.45), (0.2, 0, 0.45), 0.06)


def _post_box(parts: MeshParts, rng: np.random.Generator) -> None:
    parts.column("galvanised", (0, 0, 0), 0.05, 1.0, 6)
    color = pick(rng, ("post yellow", "post red", "sign blue"))
    parts.extrusion(color, [(-0.25, 0.75), (0.25, 0.75), (0.25, 1.3), (0.0, 1.42), (-0.25, 1.3)], -0.18, 0.18)


def _pallet(parts: MeshParts, rng: np.random.Generator) -> None:
    for i in range(int(rng.integers(1, 8))):
        x = np.linspace(-0.55, 0.45, 5)[:, None] * [1, 0, 0] + [0, 0, 0.15 * i]
        parts.boxes("wood", shifted(x, 0, -0.4, 0.11), shifted(x, 0.12, 0.4, 0.14))
        parts.boxes("wood", np.array([[-0.6, y, 0.15 * i] for y in (-0.4, -0.05, 0.3)]),
                    np.array([[0.6, y + 0.1, 0.15 * i + 0.11] for y in (-0.4, -0.05, 0.3)]))  # fmt: skip


def _cone(parts: MeshParts, rng: np.random.Generator) -> None:
    parts.box("plastic black", (-0.2, -0.2, 0.0), (0.2, 0.2, 0.04))
    parts.column("plastic orange", (0, 0, 0.04), 0.15, 0.3, 10, 0.66)
    parts.column("sign white", (0, 0, 0.34), 0.1, 0.14, 10, 0.7)
    parts.column("plastic orange", (0, 0, 0.48), 0.07, 0.2, 10, 0.3)


def _barrier(parts: MeshParts, rng: np.random.Generator) -> None:
    parts.extrusion(
        "planter", [(-0.3, 0), (0.3, 0), (0.12, 0.35), (0.08, 0.85), (-0.08, 0.85), (-0.12, 0.35)], -1.0, 1.0
    )


def _skip(parts: MeshParts, rng: np.random.Generator) -> None:
    """A refuse container with sloping ends."""
    color = pick(rng, ("post yellow", "plastic green", "sign blue"))
    parts.extrusion(color, [(-0.9, 0.1), (0.9, 0.1), (1.5, 1.2), (-1.5, 1.2)], -0.75, 0.75)
    parts.box("plastic black", (-1.4, -0.7, 1.15), (1.4, 0.7, 1.21))


def _delineator(parts: MeshParts, rng: np.random.Generator) -> None:
    parts.box("sign white", (-0.06, -0.05, 0.0), (0.06, 0.05, 0.95))
    parts.box("plastic black", (-0.065, -0.055, 0.68), (0.065, 0.055, 0.85))


# Maker, radius it needs, where across the pavement it stands, how many stand in a row.
FURNITURE: dict[str, tuple[Maker, float, str, int]] = {
    "bollard": (_bollard, 0.15, "kerb", 4),
    "bench": (_bench, 0.9, "wall", 1),
    "bin": (_bin, 0.3, "kerb", 1),
    "wheelie bin": (_wheelie, 0.35, "wall", 2),
    "sign": (_sign, 0.2, "kerb", 1),
    "planter": (_planter, 0.9, "wall", 1),
    "bicycle stand": (_bicycle_stand, 0.8, "middle", 2),
    "shelter": (_shelter, 2.2, "wall", 1),
    "hydrant": (_hydrant, 0.2, "kerb", 1),
    "post box": (_post_box, 0.3, "wall", 1),
    "pallet": (_pallet, 0.75, "wall", 2),
    "cone": (_cone, 0.2, "kerb", 3),
    "barrier": (_barrier, 1.05, "middle", 1),
    "skip": (_skip, 1.6, "wall", 1),
    "delineator": (_delineator, 0.1, "kerb", 1),
}
