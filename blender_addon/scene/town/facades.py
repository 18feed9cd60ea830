"""Fronts of buildings: walls with openings cut into them, panes set back, sills, shutters, balconies.

A front lies in the local plane y = 0, spans x from 0 to its width and looks to -y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..massing import MeshParts, shifted

REVEAL_M = 0.14
PANES = 4096  # panes are told apart by whole numbers in their UVs


@dataclass(frozen=True)
class Style:
    """How a front is divided; metres.

    Attributes:
        wall, window: materials.
        storey_m: height of a storey.
        bay_m: least distance between windows' middles.
        window_m: width and height of a window.
        sill_m: of the window above its floor.
        ground: what the lowest storey has: homes (windows and a door), shops, or windows alone.
        trim: material of sills and bands.
        shutters: their material; empty for none.
        balconies: every so many bays has balconies; 0 none.
    """

    wall: str
    window: str = "window white"
    storey_m: float = 3.0
    bay_m: float = 2.6
    window_m: tuple[float, float] = (1.15, 1.5)
    sill_m: float = 0.9
    ground: str = "homes"
    trim: str = "trim"
    shutters: str = ""
    balconies: int = 0


def front(
    parts: MeshParts, width: float, storeys: int, style: Style, rng: np.random.Generator, deep: bool = True
) -> None:
    """A front from the ground up; not ``deep``: panes lie on the wall, for fronts seen from afar or from the side."""
    count = max(1, int((width - 0.6) / style.bay_m))
    middles = (np.arange(count) + 0.5) * width / count
    for storey in range(storeys):
        low = storey * style.storey_m
        if storey == 0 and style.ground == "shops" and deep:
            _shops(parts, width, style, rng)
            continue
        door = int(rng.integers(len(middles))) if storey == 0 and style.ground == "homes" and deep else -1
        openings = _openings(middles, low, style, door)
        _storey(parts, style.wall, (0.0, width, low, low + style.storey_m), openings, deep)
        windows = np.arange(len(openings)) != door
        panes(parts, style.window, openings[windows], REVEAL_M if deep else -0.02, rng)
        if deep:
            _dress(parts, openings[windows], style)
            if door >= 0:
                _door(parts, openings[door], rng)
            if storey and style.balconies:
                _balconies(parts, middles[:: style.balconies], low)


def glass_front(parts: MeshParts, width: float, height: float, rng: np.random.Generator) -> None:
    """A curtain wall: panes of 1.5 by 3.6 m, fins and bands in front of them."""
    columns, rows = max(1, round(width / 1.5)), max(1, round(height / 3.6))
    start = rng.integers(0, PANES, 2)
    uvs = np.array([[(0, 0), (columns, 0), (columns, rows), (0, rows)]]) + start
    parts.quads("curtain wall", _upright([(0, width, 0, height)], 0.0), uvs)
    fins = np.linspace(0, width, columns // 2 + 1)[:, None] * [1, 0, 0]
    parts.boxes("galvanised fin", shifted(fins, -0.05, -0.22, 0), shifted(fins, 0.05, 0, height))
    bands = np.linspace(0, height, rows + 1)[:, None] * [0, 0, 1]
    parts.boxes("trim dark", shifted(bands, 0, -0.1, -0.16), shifted(bands, width, 0, 0.16))


def panes(
    parts: MeshParts, material: str, openings: NDArray[np.float64], depth: float, rng: np.random.Generator
) -> None:
    """Panes in openings (N, 4): x0, x1, z0, z1."""
    if len(openings):
        unit = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
        parts.quads(material, _upright(openings, depth), unit + rng.integers(0, PANES, (len(openings), 1, 2)))


def _openings(middles: NDArray[np.float64], low: float, style: Style, door: int) -> NDArray[np.float64]:
    """(N, 4) x0, x1, z0, z1 of a storey's openings."""
    half, sill, top = style.window_m[0] / 2, low + style.sill_m, low + style.sill_m + style.window_m[1]
    openings = np.stack([middles - half, middles + half, np.full_like(middles, sill), np.full_like(middles, top)], 1)
    if door >= 0:
        openings[door] = middles[door] - 0.55, middles[door] + 0.55, low + 0.02, low + 2.3
    return openings


def _storey(
    parts: MeshParts, wall: str, whole: tuple[float, float, float, float], openings: NDArray[np.float64], deep: bool
) -> None:
    """A storey's wall, and the sides of its openings when they are cut."""
    if not deep:
        parts.quads(wall, _upright([whole], 0.0))
        return
    x0, x1, z0, z1 = openings.T
    left, right, low, high = whole
    n = len(openings)
    piers = np.stack([np.append(left, x1), np.append(x0, right), np.full(n + 1, low), np.full(n + 1, high)], axis=1)
    below = np.stack([x0, x1, np.full(n, low), z0], axis=1)
    above = np.stack([x0, x1, z1, np.full(n, high)], axis=1)
    parts.quads(wall, _upright(np.concatenate([piers, below, above]), 0.0))
    face, back = _upright(openings, 0.0), _upright(openings, REVEAL_M)
    for a, b in ((0, 1), (1, 2), (2, 3), (3, 0)):
        parts.quads(wall, np.stack([face[:, a], face[:, b], back[:, b], back[:, a]], axis=1))


def _upright(rectangles: ArrayLike, depth: float) -> NDArray[np.float64]:
    """Corners (N, 4, 3) of rectangles (N, 4) x0, x1, z0, z1 in the plane y = depth."""
    rectangles = np.asarray(rectangles, float)
    corners = np.full((len(rectangles), 4, 3), depth)
    corners[..., 0] = rectangles[:, [0, 1, 1, 0]]
    corners[..., 2] = rectangles[:, [2, 2, 3, 3]]
    return corners


def _dress(parts: MeshParts, openings: NDArray[np.float64], style: Style) -> None:
    """Sills, and shutters beside."""
    if not len(openings):
        return
    x0, x1, z0, z1 = openings.T
    y = np.zeros_like(x0)
    parts.boxes(style.trim, np.stack([x0 - 0.08, y - 0.1, z0 - 0.07], 1), np.stack([x1 + 0.08, y + 0.06, z0], 1))
    if style.shutters:
        wide = (x1 - x0) / 2 * 0.9
        for a, b in ((x0 - wide - 0.03, x0 - 0.03), (x1 + 0.03, x1 + wide + 0.03)):
            parts.boxes(style.shutters, np.stack([a, y - 0.05, z0], 1), np.stack([b, y, z1], 1))


def _door(parts: MeshParts, opening: NDArray[np.float64], rng: np.random.Generator) -> None:
    material = ("door green", "door brown", "trim dark")[rng.integers(3)]
    x0, x1, z0, z1 = opening
    parts.box(material, (x0, REVEAL_M - 0.02, z0), (x1, REVEAL_M, z1))
    parts.box("trim", (x0 - 0.1, -0.35, z0 - 0.15), (x1 + 0.1, 0.05, z0 + 0.02))
    parts.box("trim", (x0 - 0.15, -0.5, z1 + 0.15), (x1 + 0.15, 0.0, z1 + 0.22))


def _balconies(parts: MeshParts, middles: NDArray[np.float64], floor: float) -> None:
    at = np.stack([middles, np.zeros_like(middles), np.full_like(middles, floor)], axis=1)
    parts.boxes("trim", shifted(at, -1.35, -1.25, -0.14), shifted(at, 1.35, 0.0, 0.02))
    parts.boxes("balcony", shifted(at, -1.35, -1.25, 0.06), shifted(at, 1.35, -1.2, 1.0))
    for x in (-1.35, 1.3):
        parts.boxes("balcony", shifted(at, x, -1.2, 0.06), shifted(at, x + 0.05, 0.0, 1.0))


def _shops(parts: MeshParts, width: float, style: Style, rng: np.random.Generator) -> None:
    """A lowest storey of shop windows under a sign, some with an awning."""
    count = max(1, round(width / 3.4))
    edges = np.linspace(0.25, width - 0.25, count + 1)
    openings = np.stack(
        [edges[:-1] + 0.14, edges[1:] - 0.14, np.full(count, 0.45), np.full(count, style.storey_m - 0.75)], axis=1
    )
    door = int(rng.integers(count))
    openings[door, 2] = 0.04
    _storey(parts, "trim dark" if rng.random() < 0.4 else style.wall, (0.0, width, 0.0, style.storey_m), openings, True)
    panes(parts, "shop window", openings, REVEAL_M, rng)
    top = style.storey_m
    sign = ("shop sign", "door green", "awning red", "trim", "door brown")[rng.integers(5)]
    parts.box(sign, (0.3, -0.12, top - 0.62), (width - 0.3, 0.0, top - 0.12))
    if rng.random() < 0.5:
        cloth = ("awning red", "awning green", "trim")[rng.integers(3)]
        x0, x1 = 0.4, width - 0.4
        corners = [(x0, -1.3, top - 1.0), (x1, -1.3, top - 1.0), (x1, -0.1, top - 0.6), (x0, -0.1, top - 0.6)]
        parts.quads(cloth, [corners])
