"""What stands along both sides of a street, and what closes the horizon."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..massing import MeshParts, turned
from . import buildings
from .site import SIDE_ROAD_HALF_M, Path, Site
from .streets import SIDE_ROAD_M
from .tables import District

BESIDE_M = 16.0  # along the street, on each side of the vehicle, where cameras stand
NEAR_M = 55.0  # fronts further than this from the vehicle are drawn flat
BUILT_HALF_M = 100.0

Builder = Callable[[MeshParts, np.random.Generator, District, float, bool], None]

# Builder, least and largest width, least and largest gap to the next.
ROWS: dict[str, tuple[Builder, tuple[float, float], tuple[float, float]]] = {
    "row": (buildings.town_house, (6.0, 12.0), (0.0, 0.0)),
    "houses": (buildings.house, (10.0, 14.5), (5.0, 10.0)),
    "towers": (buildings.tower, (18.0, 34.0), (4.0, 14.0)),
    "slabs": (buildings.slab, (26.0, 42.0), (9.0, 16.0)),
    "halls": (buildings.hall, (24.0, 44.0), (6.0, 14.0)),
    "containers": (buildings.containers, (14.0, 26.0), (3.0, 9.0)),
    "fields": (buildings.house, (10.0, 14.0), (45.0, 80.0)),
    "park": (buildings.house, (10.0, 14.0), (30.0, 60.0)),
}
SETBACK_M = {"park": 26.0, "fields": 0.0}  # beyond the district's own


def build_sides(site: Site) -> None:
    """Buildings along the main road, and along the side road behind them."""
    layout = site.layout
    for side in (-1, 1):
        rng = layout.rng("side", side)
        for stretch in site.stretches(BUILT_HALF_M, SIDE_ROAD_HALF_M + 2.2):
            _row(site, rng, layout.path, side, stretch)
        if layout.sides[side] == "fields":
            _fields(site, rng, side)
    behind = layout.district.front_m[1] + 16.0
    for number, arm in enumerate(layout.side_roads):
        for hand in (-1, 1):
            _row(site, layout.rng("side road", number, hand), arm, hand, (behind, SIDE_ROAD_M - 5.0))


def _row(site: Site, rng: np.random.Generator, path: Path, side: int, stretch: tuple[float, float]) -> None:
    layout, district = site.layout, site.layout.district
    kind = layout.sides[side]
    build, widths, gaps = ROWS[kind]
    along = stretch[0] + (rng.uniform(0, gaps[1] / 2) if gaps[1] else 0.0)
    while along < stretch[1] - widths[0]:
        width = min(rng.uniform(*widths), stretch[1] - along)
        away = rng.uniform(*district.front_m) + SETBACK_M.get(kind, 0.0)
        if path is not layout.path:
            away = SIDE_ROAD_HALF_M + max(2.5, district.front_m[0] - district.road_half_m)
        elif along < BESIDE_M and along + width > -BESIDE_M:
            away = max(away, district.clear_m + SETBACK_M.get(kind, 0.0))
        away = _inside_bend(path, side, away)
        length = width / (1 - path.curvature * side * away)
        looking = path.frame(along + length / 2, side * away, 0.0 if side > 0 else math.pi)  # its front at the path
        frame = looking @ turned(0.0, -width / 2)
        frame[2, 3] = site.ground_m(away)
        near = layout.from_vehicle((frame @ [width / 2, 0, 0, 1])[:3]) < NEAR_M
        with site.parts.at(frame):
            build(site.parts, rng, district, width, near)
        along += length + (rng.uniform(*gaps) / (1 - path.curvature * side * away) if gaps[1] else 0.0)


def _fields(site: Site, rng: np.random.Generator, side: int) -> None:
    """Strips of crops beyond the verge."""
    outer, path = site.layout.district.road_half_m + 5.0, site.layout.path
    along = -130.0
    while along < 130.0:
        length, crop = rng.uniform(35, 90), ("wheat", "soil", "meadow")[rng.integers(3)]
        far = _inside_bend(path, side, outer + rng.uniform(50, 110))
        if crop != "meadow":
            top, down = (0.35, 0.5) if crop == "wheat" else (-0.015, 0.0)
            site.lay(crop, (along, along + length - 1.5), (side * outer, side * far), top, down)
        along += length


def _inside_bend(path: Path, side: int, away: float) -> float:
    """A distance from a path, cut short on the inner side of a bend, where the sides would run into one another."""
    return min(away, 0.6 / (path.curvature * side)) if path.curvature * side > 0 else away


def build_skyline(site: Site) -> None:
    """Blocks around the district, away from its streets."""
    layout = site.layout
    rng = layout.rng("skyline")
    district = layout.district
    line = layout.path.points(np.linspace(-130, 130, 40), 0.0, 0.0)
    roads = [line, *(arm.points(np.linspace(0, 150, 30), 0.0, 0.0) for arm in layout.side_roads)]
    taken = np.concatenate(roads)[:, :2]
    for angle in np.arange(0.0, 360.0, 9.0):
        azimuth, reach = math.radians(angle + rng.uniform(-4, 4)), rng.uniform(120, 210)
        spot = reach * np.array([math.cos(azimuth), math.sin(azimuth)])
        if np.linalg.norm(taken - spot, axis=1).min() < 34 and reach < 150:
            continue
        width, height = rng.uniform(12, 30), rng.uniform(*district.skyline_m)
        with site.parts.at(turned(azimuth - math.pi / 2, *spot) @ turned(0.0, -width / 2)):
            buildings.far_block(site.parts, rng, district, width, height)
    if district.name in ("country road", "suburb"):
        _hills(site, rng)


def _hills(site: Site, rng: np.random.Generator) -> None:
    """A wooded ridge around everything."""
    angles = np.linspace(0, 2 * math.pi, 73)
    heights = 8 + 9 * np.abs(np.sin(angles * 2.5 + rng.uniform(0, 6))) + rng.uniform(0, 4, len(angles))
    heights[-1] = heights[0]
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    foot, crest = 250 * ring, 300 * ring + heights[:, None] * [0, 0, 1]
    wood = 330 * ring + heights[:, None] * [0, 0, 1.4]
    for low, high, material in ((foot, crest, "meadow"), (crest, wood, "leaves dark")):
        site.parts.quads(material, np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1))
