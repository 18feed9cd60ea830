"""Single buildings, each in its own frame: the front at y = 0 looks to -y, x runs along the street, z = 0 is ground."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ..massing import MeshParts, pick, shifted, turned
from .facades import Style, front, glass_front, panes
from .tables import District

ROOFS = ("tiles red", "tiles brown", "slate")
SHUTTERS = ("", "", "door green", "door brown", "trim")


def town_house(parts: MeshParts, rng: np.random.Generator, district: District, width: float, near: bool) -> None:
    """A house of a closed row: narrow windows, often a shop below, a roof along the street."""
    depth, storeys = rng.uniform(9, 12), int(rng.integers(2, 5)) + int(near)
    style = Style(
        wall=pick(rng, district.walls),
        window=pick(rng, ("window white", "window white", "window wood")),
        storey_m=rng.uniform(2.9, 3.4),
        bay_m=rng.uniform(2.0, 2.7),
        window_m=(rng.uniform(0.85, 1.1), rng.uniform(1.45, 1.8)),
        ground="shops" if rng.random() < 0.5 else "homes",
        shutters=pick(rng, SHUTTERS),
    )
    top = storeys * style.storey_m
    front(parts, width, storeys, style, rng, near)
    _plain_sides(parts, style.wall, width, depth, top)
    parts.box(style.trim, (0.0, -0.22, top - 0.25), (width, 0.02, top))
    if near:
        parts.box(style.trim, (0.0, -0.07, style.storey_m - 0.12), (width, 0.02, style.storey_m + 0.04))
    rise = rng.uniform(2.5, 4.5)
    parts.gable(pick(rng, ROOFS), (-0.05, -0.4, top), (width + 0.05, depth + 0.3, top + rise), style.wall)
    if near:
        _chimney(parts, width * rng.uniform(0.15, 0.85), depth * 0.6, top + rise * 0.5)


def house(parts: MeshParts, rng: np.random.Generator, district: District, width: float, near: bool) -> None:
    """A house in its garden: gabled either way, sometimes with a garage."""
    depth, storeys = rng.uniform(7.5, 9.5), 1 if rng.random() < 0.3 else 2
    garage = rng.random() < 0.6
    body = width - (3.6 if garage else 0.0)
    shutters = pick(rng, SHUTTERS)
    style = Style(pick(rng, district.walls), storey_m=2.8, bay_m=rng.uniform(2.6, 3.4), shutters=shutters)
    top, roof = storeys * style.storey_m, pick(rng, ROOFS)
    for wide, is_front in around(parts, body, depth):
        front(parts, wide, storeys, style, rng, near and is_front)
    if rng.random() < 0.5:
        parts.gable(roof, (-0.4, -0.5, top), (body + 0.4, depth + 0.5, top + rng.uniform(2.4, 3.6)), style.wall)
    else:
        with parts.at(turned(math.pi / 2, body)):
            parts.gable(roof, (-0.5, -0.4, top), (depth + 0.5, body + 0.4, top + rng.uniform(2.8, 4.2)), style.wall)
    _chimney(parts, body * 0.3, depth * 0.5, top + 1.2)
    if garage:
        parts.box(style.wall, (body, 1.5, 0.0), (width, 7.0, 2.6))
        parts.box("flat roof", (body - 0.05, 1.3, 2.6), (width + 0.1, 7.1, 2.75))
        parts.box("door white", (body + 0.4, 1.44, 0.0), (width - 0.4, 1.5, 2.2))
    if rng.random() < 0.5:
        parts.box("trim", (body * 0.35, -1.5, 2.35), (body * 0.65, 0.0, 2.5))
        for x in (0.37, 0.63):
            parts.column("trim", (body * x, -1.35, 0.0), 0.07, 2.4)


def tower(parts: MeshParts, rng: np.random.Generator, district: District, width: float, near: bool) -> None:
    """An office tower over a glazed lobby: a curtain wall, or stone with rows of windows."""
    depth, storeys = rng.uniform(16, 26), int(rng.integers(5, 19))
    wall = pick(rng, district.walls)
    lobby = 4.8
    glass = rng.random() < 0.6
    style = Style(wall, "window dark", 3.5, rng.uniform(2.4, 3.4), (rng.uniform(1.5, 2.1), 2.1), 0.8, "", "trim dark")

    for wide, is_front in around(parts, width, depth):
        _lobby(parts, rng, wall, wide, lobby)
        with parts.at(turned(0.0, z=lobby)):
            if glass:
                glass_front(parts, wide, storeys * 3.6, rng)
            else:
                front(parts, wide, storeys, style, rng, near and is_front)
    top = lobby + storeys * (3.6 if glass else 3.5)
    parts.box(wall, (0.05, 0.05, lobby - 0.5), (width - 0.05, depth - 0.05, lobby + 0.02))
    parts.box("trim dark", (-0.1, -0.1, top), (width + 0.1, depth + 0.1, top + 0.9))
    parts.box("concrete", (width * 0.3, depth * 0.3, top + 0.9), (width * 0.6, depth * 0.7, top + 4.0))
    parts.box("concrete", (0.1, 0.62, 0.0), (width - 0.1, 0.7, 0.4))


def _lobby(parts: MeshParts, rng: np.random.Generator, wall: str, width: float, height: float) -> None:
    count = max(1, round((width - 0.6) / 2.4))
    edges = np.linspace(0.3, width - 0.3, count + 1)
    low, high = np.full(count, 0.35), np.full(count, height - 0.5)
    panes(parts, "shop window", np.stack([edges[:-1], edges[1:], low, high], axis=1), 0.6, rng)
    posts = edges[:, None] * [1.0, 0.0, 0.0]
    parts.boxes(wall, shifted(posts, -0.2, 0.0, 0.0), shifted(posts, 0.2, 0.62, height))


def slab(parts: MeshParts, rng: np.random.Generator, district: District, width: float, near: bool) -> None:
    """A block of flats with balconies and a flat roof."""
    depth, storeys = rng.uniform(10, 13), int(rng.integers(4, 9))
    balconies = int(rng.integers(2, 4))
    style = Style(
        pick(rng, district.walls), "window white", 2.8, 3.1, (1.5, 1.4), 0.85, balconies=balconies if near else 0
    )
    for wide, is_front in around(parts, width, depth):
        front(parts, wide, storeys, style, rng, near and is_front)
    top = storeys * style.storey_m
    parts.box("trim", (-0.15, -0.15, top), (width + 0.15, depth + 0.15, top + 0.5))
    parts.box("concrete", (width * 0.4, depth * 0.3, top + 0.5), (width * 0.55, depth * 0.7, top + 2.8))


def hall(parts: MeshParts, rng: np.random.Generator, district: District, width: float, near: bool) -> None:
    """A hall of sheet steel with loading doors."""
    depth, height = rng.uniform(18, 28), rng.uniform(6.5, 11.0)
    wall = pick(rng, district.walls)
    _plain_sides(parts, wall, width, depth, height)
    parts.quads(wall, [[(0, 0, 0), (width, 0, 0), (width, 0, height), (0, 0, height)]])
    parts.box("concrete", (-0.06, -0.06, 0.0), (width + 0.06, depth + 0.06, 0.7))
    parts.gable("flat roof", (-0.3, -0.4, height), (width + 0.3, depth + 0.4, height + rng.uniform(0.8, 2.2)), wall)
    count = int(width / 6.5)
    middles = (np.arange(count) + 0.5) * width / count
    door = pick(rng, ("door white", "steel grey", "container blue"))
    for middle in middles[rng.random(count) < 0.7]:
        parts.box(door, (middle - 1.9, -0.1, 0.0), (middle + 1.9, 0.02, 4.2))
        parts.box("trim dark", (middle - 2.1, -0.5, 4.25), (middle + 2.1, 0.0, 4.5))
        parts.boxes("plastic black", [(middle - 2.2, -0.3, 0.3), (middle + 1.95, -0.3, 0.3)],
                    [(middle - 1.95, 0.0, 1.2), (middle + 2.2, 0.0, 1.2)])  # fmt: skip
    ribbon = np.arange(1.0, width - 2.0, 2.0)
    high = np.full_like(ribbon, height - 1.6)
    panes(parts, "ribbon window", np.stack([ribbon, ribbon + 1.9, high, high + 1.1], 1), -0.03, rng)


def containers(parts: MeshParts, rng: np.random.Generator, district: District, width: float, near: bool) -> None:
    """Stacks of freight containers, ends and sides to the street."""
    colors = ("container red", "container blue", "container ochre", "container white")
    across = rng.random() < 0.5
    long, wide = (6.06, 2.44) if across else (2.44, 6.06)
    for row in range(2):
        x = 0.0
        while x + long <= width:
            for level in range(int(rng.integers(0, 4))):
                low = np.array([x + rng.uniform(-0.08, 0.08), row * (wide + 0.6), level * 2.6])
                color = pick(rng, colors)
                parts.box(color, low, shifted(low, long, wide, 2.58))
                ends = shifted(low, 0.0, -0.03, 0.1)
                bars = ends + np.linspace(0.25, long - 0.3, 4)[:, None] * [1, 0, 0]
                parts.boxes("galvanised", bars, shifted(bars, 0.05, 0.04, 2.35))
            x += long + 0.3


def far_block(parts: MeshParts, rng: np.random.Generator, district: District, width: float, height: float) -> None:
    """Something plain at the horizon."""
    wall, depth = pick(rng, district.walls), rng.uniform(9, 16)
    style = Style(wall, "window dark", 3.0, 3.2, (1.4, 1.5), ground="")
    storeys = max(1, int(height / 3.0))
    top = storeys * 3.0
    for wide, _ in around(parts, width, depth):
        front(parts, wide, storeys, style, rng, False)
    if height < 24 and rng.random() < 0.7:
        parts.gable(pick(rng, ROOFS), (-0.3, -0.3, top), (width + 0.3, depth + 0.3, top + 3.0), wall)
    else:
        parts.box("flat roof", (0, 0, top), (width, depth, top + 0.5))


def around(parts: MeshParts, width: float, depth: float) -> Iterator[tuple[float, bool]]:
    """Step through a building's four sides, front first; yields each side's width and whether it is the front."""
    turns = ((0.0, 0.0, 0.0, width), (math.pi / 2, width, 0.0, depth),
             (math.pi, width, depth, width), (-math.pi / 2, 0.0, depth, depth))  # fmt: skip
    for i, (angle, x, y, wide) in enumerate(turns):
        with parts.at(turned(angle, x, y)):
            yield wide, i == 0


def _plain_sides(parts: MeshParts, wall: str, width: float, depth: float, height: float) -> None:
    for wide, is_front in around(parts, width, depth):
        if not is_front:
            parts.quads(wall, [[(0, 0, 0), (wide, 0, 0), (wide, 0, height), (0, 0, height)]])


def _chimney(parts: MeshParts, x: float, y: float, z: float) -> None:
    parts.box("brick red", (x - 0.35, y - 0.3, z), (x + 0.35, y + 0.3, z + 2.6))
