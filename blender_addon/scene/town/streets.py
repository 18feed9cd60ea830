"""Ground: road, side road, markings, kerbs, pavements, patches and covers."""

from __future__ import annotations

import math

import numpy as np

from .site import HALF_LENGTH_M, PAVED_M, SIDE_ROAD_HALF_M, Path, Site, ribbon

KERB_M = 0.15
APRON_M = 62.0  # the district's own ground reaches this far from the middle line
TERRAIN_M = 420.0
TERRAIN_HEIGHT_M = -0.03
MARKING_HEIGHT_M, PATCH_HEIGHT_M, COVER_HEIGHT_M = 0.004, 0.002, 0.005
SIDE_ROAD_M = 110.0
BAY_M = {True: (3.2, 5.0), False: (6.0, 2.2)}  # length and depth of parking bays: square to a yard, along a street


def build_ground(site: Site) -> None:
    """Everything flat."""
    layout, parts = site.layout, site.parts
    district, path = layout.district, layout.path
    reach = TERRAIN_M
    parts.box(district.apron, (-reach, -reach, -0.6), (reach, reach, TERRAIN_HEIGHT_M))
    half = district.road_half_m
    ribbon(parts, path, district.road, (-HALF_LENGTH_M, HALF_LENGTH_M), (-half, half), 0.0, 0.2)
    for arm in layout.side_roads:
        ribbon(parts, arm, district.road, (0.0, SIDE_ROAD_M), (-SIDE_ROAD_HALF_M, SIDE_ROAD_HALF_M), 0.0, 0.2)
    for side in (-1, 1):
        if district.pavement_m:
            _paved_side(site, side)
        elif district.pavement == "gravel":
            ribbon(parts, path, "gravel", (-HALF_LENGTH_M, HALF_LENGTH_M), (side * half, side * (half + 1.1)), -0.01)
    _mark(site)
    _mend(site)


def _paved_side(site: Site, side: int) -> None:
    layout, parts = site.layout, site.parts
    half, outer, down = layout.district.road_half_m, layout.outer_m, 0.3
    for along in site.stretches(HALF_LENGTH_M, SIDE_ROAD_HALF_M):
        ribbon(parts, layout.path, "kerb", along, (side * half, side * (half + KERB_M)), PAVED_M + 0.01, down)
        slab = (side * (half + KERB_M), side * outer)
        ribbon(parts, layout.path, layout.district.pavement, along, slab, PAVED_M, down)
        ribbon(parts, layout.path, layout.district.apron, along, (side * outer, side * APRON_M), PAVED_M - 0.005, down)
    edge = SIDE_ROAD_HALF_M
    for arm in layout.side_roads if side == 1 else []:
        for hand in (-1, 1):
            reach = (0.0, SIDE_ROAD_M)
            ribbon(parts, arm, "kerb", reach, (hand * edge, hand * (edge + KERB_M)), PAVED_M + 0.02, down)
            slab = (hand * (edge + KERB_M), hand * (edge + 1.8))
            beyond = (layout.district.pavement_m, SIDE_ROAD_M)
            ribbon(parts, arm, layout.district.pavement, beyond, slab, PAVED_M + 0.01, down)


def _mark(site: Site) -> None:
    """Lines on the road."""
    layout = site.layout
    lines, half = layout.district.lines, layout.district.road_half_m
    if lines in ("city", "country", "bays") and half < 9:
        _dashes(site, 0.0, 3.0, 6.0 if lines != "country" else 9.0)
    if layout.district.lanes == 2:
        for side in (-1, 1):
            _dashes(site, side * half / 2, 2.0, 6.0)
    if lines == "country":
        for side in (-1, 1):
            _line(site, (-HALF_LENGTH_M, HALF_LENGTH_M), side * (half - 0.25), 0.12)
    if lines == "bays":
        _bays(site)
    if lines in ("city", "bays") and half < 9:
        _zebras(site)


def _line(site: Site, along: tuple[float, float], aside: float, width: float, material: str = "marking") -> None:
    band = (aside - width / 2, aside + width / 2)
    ribbon(site.parts, site.layout.path, material, along, band, MARKING_HEIGHT_M)


def _dashes(site: Site, aside: float, length: float, gap: float) -> None:
    for start in np.arange(-HALF_LENGTH_M, HALF_LENGTH_M, length + gap).tolist():
        if site.clear_of_crossing(start + length / 2, 7.0):
            _line(site, (start, start + length), aside, 0.12)


def _bays(site: Site) -> None:
    half = site.layout.district.road_half_m
    length, depth = BAY_M[half >= 9]
    for side in (-1, 1):
        for along in np.arange(-60.0, 60.0, length).tolist():
            if site.clear_of_crossing(along, 4.0):
                band = (side * (half - depth), side * (half - 0.05))
                place = (along - 0.06, along + 0.06)
                ribbon(site.parts, site.layout.path, "marking", place, band, MARKING_HEIGHT_M)


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
        ribbon(site.parts, arm, "marking", (2.2, 2.6), (0.1, SIDE_ROAD_HALF_M - 0.2), MARKING_HEIGHT_M)
        for start in np.arange(4.0, SIDE_ROAD_M, 9.0).tolist():
            ribbon(site.parts, arm, "marking", (start, start + 3.0), (-0.06, 0.06), MARKING_HEIGHT_M)


def _mend(site: Site) -> None:
    """Patches in the asphalt, and covers of iron."""
    layout = site.layout
    rng, half = layout.rng("patches"), layout.district.road_half_m
    kinds = {"asphalt": ("asphalt patch", "asphalt old patch"), "worn concrete": ("asphalt old patch", "asphalt patch")}
    for _ in range(9 if layout.district.road in kinds else 0):
        along, aside = rng.uniform(-35, 35), rng.uniform(-half + 1.2, half - 1.2)
        length, width = rng.uniform(0.8, 6.0), rng.uniform(0.5, 1.1)
        material = kinds[layout.district.road][rng.integers(2)]
        ends, band = (along, along + length), (aside - width, aside + width)
        ribbon(site.parts, layout.path, material, ends, band, PATCH_HEIGHT_M * rng.uniform(0.6, 1.0))
    for along in np.arange(-42.0, 43.0, 12.0).tolist():
        with site.parts.at(layout.path.frame(along + rng.uniform(-3, 3), rng.uniform(-0.6, 0.6) * half)):
            site.parts.column("iron", (0, 0, -0.1), 0.33, 0.1 + COVER_HEIGHT_M, 14)
    if layout.district.pavement_m:
        _gullies(site, layout.path, half)


def _gullies(site: Site, path: Path, half: float) -> None:
    for side in (-1, 1):
        for along in np.arange(-44.0, 45.0, 17.0).tolist():
            if site.clear_of_crossing(along):
                with site.parts.at(path.frame(along, side * (half - 0.24), math.pi / 2 * (1 + side))):
                    site.parts.box("iron", (-0.28, -0.2, -0.1), (0.28, 0.2, COVER_HEIGHT_M))
