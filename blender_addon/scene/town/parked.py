"""Parked vehicles of other classes: each an object of its own, so that masks and boxes tell them apart."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..massing import MeshParts, pick, shifted
from .site import Site

ENAMELS = ("enamel white", "enamel white", "enamel red", "enamel blue", "enamel green", "enamel yellow")
LIVERIES = ("enamel white", "enamel white", "enamel blue", "tarpaulin", "enamel yellow", "enamel green")

Maker = Callable[[MeshParts, np.random.Generator], None]


@dataclass(frozen=True)
class Model:
    """How to make one, and the room it takes: length and width, metres."""

    make: Maker
    length_m: float
    width_m: float


def _wheel(parts: MeshParts, x: float, y: float, radius: float, width: float) -> None:
    parts.beam("vehicle tyre", (x, y - width / 2, radius), (x, y + width / 2, radius), radius, 16)
    rim = width / 2 + 0.012
    parts.beam("chrome", (x, y - rim, radius), (x, y + rim, radius), radius * 0.5, 10)


def _lamps(parts: MeshParts, material: str, x: float, y: float, z: float, size: tuple[float, float]) -> None:
    """A pair of lamps on a plane x = const."""
    for side in (-1, 1):
        low = (x - 0.03, side * y - size[0] / 2, z - size[1] / 2)
        parts.box(material, low, (x + 0.03, side * y + size[0] / 2, z + size[1] / 2))


def truck(parts: MeshParts, rng: np.random.Generator) -> None:
    """A box truck: cab over the engine, a tall load box behind."""
    length, width, top = 8.2, 2.4, rng.uniform(3.1, 3.7)
    rear, cab_rear, nose = -length / 2, length / 2 - 1.9, length / 2
    cab, load = pick(rng, ENAMELS), pick(rng, LIVERIES)
    half = width / 2
    parts.box("chassis", (rear + 0.1, -0.45, 0.5), (nose - 0.3, 0.45, 0.85))
    parts.box(load, (rear, -half, 0.95), (cab_rear - 0.15, half, top))
    rails = np.array([[rear - 0.01, -half - 0.015, z] for z in (0.95, top - 0.1)])
    parts.boxes("chrome", rails, shifted(rails, cab_rear - 0.13 - rear, width + 0.03, 0.1))
    profile = [(cab_rear, 0.55), (nose, 0.55), (nose, 1.25), (nose - 0.28, 2.35), (nose - 0.5, 2.55), (cab_rear, 2.55)]
    parts.extrusion(cab, profile, -half + 0.08, half - 0.08)
    _screen(parts, (nose + 0.012, 1.38), (nose - 0.25, 2.28), half - 0.22)
    for side in (-1, 1):
        y = side * (half - 0.07)
        window = [(cab_rear + 0.55, 1.4), (nose - 0.12, 1.4), (nose - 0.34, 2.2), (cab_rear + 0.55, 2.2)]
        parts.extrusion("vehicle glass", window, *sorted((y, y + side * 0.012)))
        parts.box(
            "plastic trim",
            (nose - 0.35, side * (half + 0.02) - 0.1, 1.55),
            (nose - 0.2, side * (half + 0.02) + 0.1, 2.1),
        )
        parts.box("chassis", (rear + 2.9, side * half - 0.05, 0.45), (cab_rear - 0.6, side * half + 0.05, 0.9))
    parts.box("plastic trim", (nose - 0.1, -half + 0.06, 0.4), (nose + 0.08, half - 0.06, 0.75))
    parts.box("plastic trim", (nose - 0.02, -0.75, 0.85), (nose + 0.02, 0.75, 1.18))
    _lamps(parts, "head lamp", nose + 0.07, half - 0.35, 0.6, (0.4, 0.18))
    _lamps(parts, "tail lamp", rear, half - 0.25, 0.8, (0.4, 0.16))
    for x in (nose - 1.25, rear + 1.9):
        for y in (-half + 0.2, half - 0.2):
            _wheel(parts, x, y, 0.48, 0.3)


def tipper(parts: MeshParts, rng: np.random.Generator) -> None:
    """A tipper: an open bin behind a cab, three axles."""
    length, width = 7.4, 2.45
    rear, nose, half = -length / 2, length / 2, width / 2
    cab_rear = nose - 1.8
    cab, bin_color = pick(rng, ENAMELS), pick(rng, ("enamel red", "enamel yellow", "enamel blue", "chassis"))
    parts.box("chassis", (rear + 0.3, -0.45, 0.55), (nose - 0.3, 0.45, 0.95))
    tray = [(rear, 1.15), (cab_rear - 0.2, 1.0), (cab_rear - 0.1, 2.3), (rear - 0.15, 2.2)]
    for y in (-half, half - 0.08):
        parts.extrusion(bin_color, tray, y, y + 0.08)
    parts.extrusion(bin_color, [(rear, 1.1), (cab_rear - 0.2, 0.97), (cab_rear - 0.2, 1.05), (rear, 1.2)], -half, half)
    parts.box(bin_color, (cab_rear - 0.2, -half, 1.0), (cab_rear - 0.1, half, 2.5))
    parts.box(bin_color, (rear - 0.1, -half, 1.1), (rear, half, 2.15))
    ribs = np.linspace(rear + 0.5, cab_rear - 0.6, 5)[:, None] * [1, 0, 0]
    for y in (-half - 0.06, half):
        parts.boxes(bin_color, shifted(ribs, 0, y, 1.15), shifted(ribs, 0.12, y + 0.06, 2.2))
    profile = [(cab_rear, 0.6), (nose, 0.6), (nose, 1.35), (nose - 0.2, 2.5), (nose - 0.4, 2.7), (cab_rear, 2.7)]
    parts.extrusion(cab, profile, -half + 0.08, half - 0.08)
    _screen(parts, (nose + 0.012, 1.45), (nose - 0.18, 2.42), half - 0.22)
    for side in (-1, 1):
        y = side * (half - 0.07)
        window = [(cab_rear + 0.5, 1.5), (nose - 0.12, 1.5), (nose - 0.28, 2.35), (cab_rear + 0.5, 2.35)]
        parts.extrusion("vehicle glass", window, *sorted((y, y + side * 0.012)))
    parts.box("plastic trim", (nose - 0.1, -half + 0.06, 0.42), (nose + 0.1, half - 0.06, 0.85))
    _lamps(parts, "head lamp", nose + 0.09, half - 0.35, 0.65, (0.4, 0.2))
    _lamps(parts, "tail lamp", rear + 0.3, half - 0.3, 0.8, (0.35, 0.15))
    for x in (nose - 1.2, rear + 2.4, rear + 1.25):
        for y in (-half + 0.2, half - 0.2):
            _wheel(parts, x, y, 0.52, 0.32)


def bus(parts: MeshParts, rng: np.random.Generator) -> None:
    """A city bus: a band of windows all around, two doors on the right."""
    length, width, top = 11.2, 2.55, 3.05
    rear, nose, half = -length / 2, length / 2, width / 2
    body, skirt = pick(rng, ENAMELS[2:]), pick(rng, ENAMELS)
    profile = [(rear, 0.35), (nose, 0.35), (nose + 0.02, 1.2), (nose - 0.18, top - 0.15), (nose - 0.4, top),
               (rear + 0.3, top), (rear, top - 0.25)]  # fmt: skip
    parts.extrusion(body, profile, -half, half)
    parts.box(skirt, (rear + 0.02, -half - 0.012, 0.38), (nose - 0.02, half + 0.012, 0.85))
    parts.box("enamel white", (rear + 1.5, -0.9, top), (nose - 3.5, 0.9, top + 0.25))
    _screen(parts, (nose + 0.034, 1.0), (nose - 0.15, top - 0.35), half - 0.12)
    parts.box("plastic trim", (nose - 0.2, -0.9, top - 0.33), (nose - 0.08, 0.9, top - 0.08))
    parts.box("vehicle glass", (rear - 0.012, -half + 0.25, 1.5), (rear + 0.05, half - 0.25, top - 0.4))
    x = np.linspace(rear + 0.35, nose - 0.55, 8)
    for side in (-1, 1):
        y = sorted((side * (half - 0.03), side * (half + 0.01)))
        at = np.stack([x[:-1], np.full(7, y[0]), np.full(7, 1.3)], axis=1)
        parts.boxes("vehicle glass", shifted(at, 0.05, 0, 0), shifted(at, float(x[1] - x[0]) - 0.05, y[1] - y[0], 1.15))
        mirror = side * (half + 0.2)
        parts.box("plastic trim", (nose + 0.05, mirror - 0.1, 1.9), (nose + 0.15, mirror + 0.1, 2.4))
    for door in (nose - 1.75, -0.6):
        parts.box("vehicle glass", (door, -half - 0.02, 0.45), (door + 0.56, -half, 2.5))
        parts.box("vehicle glass", (door + 0.62, -half - 0.02, 0.45), (door + 1.18, -half, 2.5))
    _lamps(parts, "head lamp", nose + 0.02, half - 0.35, 0.7, (0.45, 0.2))
    _lamps(parts, "tail lamp", rear, half - 0.2, 1.1, (0.2, 0.5))
    for x0 in (nose - 2.7, rear + 3.0):
        for y0 in (-half + 0.14, half - 0.14):
            parts.beam("chassis", (x0, y0 * 1.0, 0.5), (x0, y0 + math.copysign(0.16, y0), 0.5), 0.58, 14)
            _wheel(parts, x0, y0 + math.copysign(0.03, y0), 0.48, 0.3)


def _screen(parts: MeshParts, low: tuple[float, float], high: tuple[float, float], half: float) -> None:
    """A windscreen between two heights, (x, z) each."""
    (x0, z0), (x1, z1) = low, high
    parts.quads("vehicle glass", [[(x0, -half, z0), (x0, half, z0), (x1, half, z1), (x1, -half, z1)]])


def motorcycle(parts: MeshParts, rng: np.random.Generator) -> None:
    """A roadster on its stand."""
    color = pick(rng, ("enamel red", "enamel black", "enamel blue", "enamel green", "enamel yellow"))
    for x in (-0.72, 0.72):
        _tyre(parts, x, 0.31, 0.075, "vehicle tyre")
        parts.beam("chrome", (x, -0.05, 0.31), (x, 0.05, 0.31), 0.17, 10)
    for y in (-0.11, 0.11):
        parts.beam("chrome", (0.72, y, 0.31), (0.42, y, 0.98), 0.028)
        parts.beam("chassis", (-0.72, y, 0.31), (-0.1, y, 0.5), 0.03)
        parts.beam("chrome", (0.1, y * 1.5, 0.3), (-0.9, y * 1.7, 0.42), 0.045)
    parts.extrusion("chassis", [(-0.2, 0.25), (0.32, 0.25), (0.36, 0.55), (0.1, 0.68), (-0.28, 0.6)], -0.17, 0.17)
    parts.extrusion(color, [(-0.12, 0.68), (0.4, 0.7), (0.44, 0.86), (0.28, 0.98), (-0.1, 0.84)], -0.15, 0.15)
    parts.extrusion(
        "vehicle tyre", [(-0.85, 0.84), (-0.1, 0.72), (-0.08, 0.82), (-0.5, 0.86), (-0.85, 0.94)], -0.13, 0.13
    )
    parts.extrusion(color, [(-1.0, 0.72), (-0.4, 0.68), (-0.5, 0.83), (-1.0, 0.86)], -0.1, 0.1)
    parts.extrusion(color, [(0.45, 0.62), (0.98, 0.66), (0.78, 0.71), (0.5, 0.7)], -0.07, 0.07)
    parts.beam("chrome", (0.36, -0.36, 1.06), (0.36, 0.36, 1.06), 0.022)
    parts.beam("vehicle tyre", (0.33, 0.22, 1.06), (0.3, 0.38, 1.05), 0.03)
    parts.beam("vehicle tyre", (0.33, -0.22, 1.06), (0.3, -0.38, 1.05), 0.03)
    parts.beam("head lamp", (0.5, 0, 0.92), (0.6, 0, 0.92), 0.1, 10)
    parts.box("tail lamp", (-1.02, -0.07, 0.76), (-0.99, 0.07, 0.83))
    for y in (-0.3, 0.3):
        parts.box("plastic trim", (0.38, y - 0.06, 1.2), (0.4, y + 0.06, 1.28))
        parts.beam("plastic trim", (0.37, y * 0.9, 1.06), (0.39, y, 1.22), 0.01)
    parts.beam("chassis", (-0.1, 0.12, 0.3), (-0.15, 0.3, 0.0), 0.02)


def bicycle(parts: MeshParts, rng: np.random.Generator) -> None:
    """A town bicycle."""
    color = pick(rng, ("enamel red", "enamel black", "enamel blue", "enamel green", "enamel white"))
    for x in (-0.52, 0.52):
        _tyre(parts, x, 0.34, 0.024, "vehicle tyre")
        for angle in np.arange(6) * math.pi / 6:
            reach = 0.32 * np.array([math.cos(angle), 0.0, math.sin(angle)])
            parts.beam("chrome", np.array([x, 0, 0.34]) - reach, np.array([x, 0, 0.34]) + reach, 0.004, 3)
    crank, seat, head, rear, fore = (-0.08, 0, 0.3), (-0.2, 0, 0.82), (0.33, 0, 0.82), (-0.52, 0, 0.34), (0.52, 0, 0.34)
    for a, b in ((crank, seat), (crank, head), (seat, head), (rear, seat), (rear, crank), (head, fore)):
        parts.beam(color, a, b, 0.022)
    parts.beam("chrome", seat, (-0.24, 0, 0.96), 0.016)
    parts.box("vehicle tyre", (-0.36, -0.07, 0.95), (-0.1, 0.07, 1.0))
    parts.beam("chrome", head, (0.29, 0, 1.02), 0.016)
    parts.beam("chrome", (0.27, -0.28, 1.03), (0.27, 0.28, 1.03), 0.014)
    parts.beam("chassis", (-0.08, -0.06, 0.3), (-0.08, 0.06, 0.3), 0.09, 9)
    for side in (-1, 1):
        parts.box(
            "chassis", (-0.08 + side * 0.12, side * 0.1 - 0.05, 0.28), (0.0 + side * 0.12, side * 0.1 + 0.05, 0.3)
        )
    if rng.random() < 0.5:
        parts.box("plastic trim", (0.42, -0.18, 0.8), (0.72, 0.18, 1.02))


def _tyre(parts: MeshParts, x: float, radius: float, tube: float, material: str) -> None:
    """A ring in the plane y = 0 that rolls on z = 0."""
    turns, sides = 20, 5
    around, across = np.arange(turns) * 2 * math.pi / turns, np.arange(sides) * 2 * math.pi / sides
    reach = radius - tube + tube * np.cos(across)  # (sides,)
    points = np.stack(
        [
            x + np.cos(around)[:, None] * reach,
            np.broadcast_to(tube * np.sin(across), (turns, sides)),
            radius + np.sin(around)[:, None] * reach,
        ],
        axis=-1,
    )
    i = np.arange(turns * sides).reshape(turns, sides)
    j, k = np.roll(i, -1, axis=0), np.roll(i, -1, axis=1)
    faces = np.stack([i, j, np.roll(j, -1, axis=1), k], axis=-1).reshape(-1, 4)
    parts.polygons(material, points.reshape(-1, 3), faces, smooth=True)


MODELS: dict[str, tuple[Model, ...]] = {
    "truck": (Model(truck, 8.4, 2.7), Model(truck, 8.4, 2.7), Model(tipper, 7.7, 2.7)),
    "bus": (Model(bus, 11.5, 2.9),),
    "motorcycle": (Model(motorcycle, 2.1, 0.8),),
    "bicycle": (Model(bicycle, 1.8, 0.6),),
}


LARGE = ("truck", "bus")
LARGE_ROOM_M = 10.5  # from the vehicle's middle: nearer, they would stand where the cameras do
SMALL_ROOM_M = 4.6
SPREAD_M = 42.0
TRIES = 12
MOST = 254  # instance numbers are bytes, and two are taken


def build_parked(site: Site) -> list[tuple[str, MeshParts, NDArray[np.float64]]]:
    """(COCO class, mesh, district frame) of each vehicle parked along the street."""
    district, rng = site.layout.district, site.layout.rng("parked")
    wanted = [district.parked[i] for i in rng.integers(0, len(district.parked), int(rng.integers(3, 7)))]
    parked = []
    for category in sorted(wanted, key=lambda name: name not in LARGE):  # the large ones first: they need the room
        model = MODELS[category][int(rng.integers(len(MODELS[category])))]
        for _ in range(TRIES):
            frame = _spot(site, rng, category, model)
            room = model.length_m / 2
            least = LARGE_ROOM_M if category in LARGE else SMALL_ROOM_M
            if site.layout.from_vehicle(frame[:3, 3]) - room * (category not in LARGE) < least:
                continue
            crossed = not site.clear_of_crossing(float(frame[0, 3]), model.length_m / 2 + 4.0)
            if not crossed and site.claim(frame, model.width_m / 2 + 0.1, model.length_m):
                parts = MeshParts()
                model.make(parts, rng)
                parked.append((category, parts, frame))
                break
    return parked[:MOST]


def _spot(site: Site, rng: np.random.Generator, category: str, model: Model) -> NDArray[np.float64]:
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
