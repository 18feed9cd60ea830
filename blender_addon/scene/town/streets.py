"""Ground: road, side road, markings, kerbs, pavements, patches and covers."""

from __future__ import annotations

import math

import numpy as np

from .site import HALF_LENGTH_M, PAVED_M, SIDE_ROAD_HALF_M, Site

KERB_M = 0.15
APRON_M = 62.0  # the district's own ground reaches this far from the middle line
TERRAIN_M = 420.0
TERRAIN_HEIGHT_M = -0.03
MARKING_HEIGHT_M, PATCH_HEIGHT_M, COVER_HEIGHT_M = 0.004, 0.002, 0.005
SIDE_ROAD_M = 110.0
BAY_M = {True: (3.2, 5.0), False: (6.0, 2.2)}  # length and depth of parking bays: square to a yard, along a street
WHOLE, ARM = (-HALF_LENGTH_M, HALF_LENGTH_M), (0.0, SIDE_ROAD_M)
MENDED = {"asphalt": ("asphalt patch", "asphalt old patch"), "worn concrete": ("asphalt old patch", "asphalt patch")}


def build_ground(site: Site) -> None:
    """Everything flat."""
    layout, district = site.layout, site.layout.district
    half = district.road_half_m
    site.parts.box(district.apron, (-TERRAIN_M, -TERRAIN_M, -0.6), (TERRAIN_M, TERRAIN_M, TERRAIN_HEIGHT_M))
    site.lay(district.road, WHOLE, (-half, half), 0.0, 0.2)
    for arm in layout.side_roads:
        site.lay(district.road, ARM, (-SIDE_ROAD_HALF_M, SIDE_ROAD_HALF_M), 0.0, 0.2, arm)
    for side in (-1, 1):
        if district.pavement_m:
            _paved_side(site, side)
        elif district.pavement == "gravel":
            site.lay("gravel", WHOLE, (side * half, side * (half + 1.1)), -0.01)
    _mark(site)
    _mend(site)


def _paved_side(site: Site, side: int) -> None:
    layout, district = site.layout, site.layout.district
    half, outer, down = district.road_half_m, layout.outer_m, 0.3
    for along in site.stretches(HALF_LENGTH_M, SIDE_ROAD_HALF_M):
        site.lay("kerb", along, (side * half, side * (half + KERB_M)), PAVED_M + 0.01, down)
        site.lay(district.pavement, along, (side * (half + KERB_M), side * outer), PAVED_M, down)
        site.lay(district.apron, along, (side * outer, side * APRON_M), PAVED_M - 0.005, down)
    edge, beyond = SIDE_ROAD_HALF_M, (district.pavement_m, SIDE_ROAD_M)
    for arm in layout.side_roads if side == 1 else []:
        for hand in (-1, 1):
            site.lay("kerb", ARM, (hand * edge, hand * (edge + KERB_M)), PAVED_M + 0.02, down, arm)
            slab = (hand * (edge + KERB_M), hand * (edge + 1.8))
            site.lay(district.pavement, beyond, slab, PAVED_M + 0.01, down, arm)


def _mark(site: Site) -> None:
    """Lines on the road."""
    district = site.layout.district
    lines, half = district.lines, district.road_half_m
    if lines != "none" and half < 9:
        _dashes(site, 0.0, 3.0, 6.0 if lines != "country" else 9.0)
    length, depth = BAY_M[half >= 9]
    for side in (-1, 1):
        if district.lanes == 2:
            _dashes(site, side * half / 2, 2.0, 6.0)
        elif lines == "country":
            _line(site, WHOLE, side * (half - 0.25), 0.12)
        elif lines == "bays":
            for along in np.arange(-60.0, 60.0, length).tolist():
                if site.clear_of_crossing(along, 4.0):
                    band = (side * (half - depth), side * (half - 0.05))
                    site.lay("marking", (along - 0.06, along + 0.06), band, MARKING_HEIGHT_M)
    if lines in ("city", "bays") and half < 9:
        _zebras(site)


def _line(site: Site, along: tuple[float, float], aside: float, width: float, material: str = "marking") -> None:
    site.lay(material, along, (aside - width / 2, aside + width / 2), MARKING_HEIGHT_M)


def _dashes(site: Site, aside: float, length: float, gap: float) -> None:
    for start in np.arange(-HALF_LENGTH_M, HALF_LENGTH_M, length + gap).tolist():
        if site.clear_of_crossing(start + length / 2, 7.0):
            _line(site, (start, start + length), aside, 0.12)


def _zebras(site: Site) -> None:
    """Crossings for pedestrians beside the side road, or one anywhere, with a stop line before each."""
    layout = site.layout
    rng, half = layout.rng("zebras"), layout.district.road_half_m
    crossing = layout.crossing_m
    reach = SIDE_ROAD_HALF_M + 2.0
    spots = [crossing - reach - 3.0, crossing + reach] if crossing is not None else [float(rng.uniform(8, 30))]
    color = "marking yellow" if rng.random() < 0.25 else "marking"
    for start in spots:
        for aside in np.arange(-half + 0.5, half - 0.3, 1.0).tolist():
            _line(site, (start, start + 3.0), aside, 0.5, color)
    for arm in layout.side_roads:
        site.lay("marking", (2.2, 2.6), (0.1, SIDE_ROAD_HALF_M - 0.2), MARKING_HEIGHT_M, path=arm)
        for start in np.arange(4.0, SIDE_ROAD_M, 9.0).tolist():
            site.lay("marking", (start, start + 3.0), (-0.06, 0.06), MARKING_HEIGHT_M, path=arm)


def _mend(site: Site) -> None:
    """Patches in the asphalt, covers and gullies of iron."""
    layout, district = site.layout, site.layout.district
    rng, half = layout.rng("patches"), district.road_half_m
    for _ in range(9 if district.road in MENDED else 0):
        along, aside = rng.uniform(-35, 35), rng.uniform(-half + 1.2, half - 1.2)
        length, width = rng.uniform(0.8, 6.0), rng.uniform(0.5, 1.1)
        material = MENDED[district.road][rng.integers(2)]
        height = PATCH_HEIGHT_M * rng.uniform(0.6, 1.0)
        site.lay(material, (along, along + length), (aside - width, aside + width), height)
    for along in np.arange(-42.0, 43.0, 12.0).tolist():
        with site.parts.at(layout.path.frame(along + rng.uniform(-3, 3), rng.uniform(-0.6, 0.6) * half)):
            site.parts.column("iron", (0, 0, -0.1), 0.33, 0.1 + COVER_HEIGHT_M, 14)
    gullies = np.arange(-44.0, 45.0, 17.0).tolist() if district.pavement_m else []
    for side in (-1, 1):
        for along in gullies:
            if site.clear_of_crossing(along):
                with site.parts.at(layout.path.frame(along, side * (half - 0.24), math.pi / 2 * (1 + side))):
                    site.parts.box("iron", (-0.28, -0.2, -0.1), (0.28, 0.2, COVER_HEIGHT_M))
