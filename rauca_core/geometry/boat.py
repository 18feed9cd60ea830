"""The procedural motor boats, on the blocks they stand on ashore: profile tables in, an unwrapped vehicle out.

A hull, cabins of four leaning walls, and what is fitted: rails, mast, seats, outboard engine, and the blocks below it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contract import Vehicle
from .assemble import assemble, read_profile
from .mesh import MeshParts, Points
from .solids import add_solids, add_tube, curve_through

BOATS = ("boat", "boat_detailed")
CENTRAL_PANELS = ("deck", "transom", "roof", "house front", "house rear")
CROWN_M = 0.04  # the roof of a cabin is this much higher in the middle


def build_boat(name: str) -> Vehicle:
    """Build and unwrap the boat of ``assets/vehicles/<name>.toml``; deterministic."""
    profile = read_profile(name)
    half = MeshParts()
    sheer = _add_hull(half, profile["hull"])
    for house in profile.get("houses", []):
        add_house(half, house)
    for rail in profile.get("rails", []):
        add_rail(half, sheer, rail)
    add_solids(half, profile["blocks"])
    whole = half.both_sides()
    add_solids(whole, profile.get("fittings", []))
    return assemble(name, "boat", whole, CENTRAL_PANELS)


def _add_hull(parts: MeshParts, hull: dict[str, Any]) -> Points:
    """The left half of hull, transom and deck; returns the sheer line (N, 3), from the stern to the bow."""
    at = np.linspace(0.0, 1.0, hull["stations"])
    keel, chine, sheer = (curve_through(np.array(hull[line]), at) for line in ("keel", "chine", "sheer"))
    bottom = _between(keel, chine, np.linspace(0, 1, 4))
    side = _between(chine, sheer, np.linspace(0, 1, hull["strakes"] + 1))
    # Topsides hollow out towards the bow, where they throw the spray aside.
    hollow = np.sin(np.pi * np.linspace(0, 1, hull["strakes"] + 1)) * hull["flare"]
    side[..., 1] *= 1 - hollow * np.clip(at * 2 - 0.8, 0, 1)[:, None]
    parts.grid(bottom, "paint/bottom", flip=True)
    bands = np.full((len(at) - 1, hull["strakes"]), "paint/side", dtype="U32")
    if hull["rubbing_strake"]:
        bands[:, -1] = "rubber"
    parts.grid(side, bands, flip=True)
    # The transom closes the stern, fanned from the middle line.
    outline = np.concatenate([bottom[0, :-1], side[0]])
    middle = outline * [1, 0, 1]
    parts.grid(np.stack([middle, outline], axis=0), "paint/transom", flip=True)
    _add_deck(parts, hull, sheer)
    return sheer


def _add_deck(parts: MeshParts, hull: dict[str, Any], sheer: Points) -> None:
    """The deck inside the sheer, a little higher in the middle; the transom reaches up to it."""
    share = np.array([0.0, 0.25, 0.5, 0.70, 0.84, 1.0])
    deck = np.repeat(sheer[:, None], len(share), axis=1)
    deck[..., 1] *= share
    deck[..., 2] += hull["camber"] * (1 - share**2) * np.minimum(1, sheer[:, 1:2])
    level = deck[0] * [1, 1, 0] + [0, 0, sheer[0, 2]]
    parts.grid(np.stack([level, deck[0]], axis=1), "paint/transom", flip=True)
    names = np.full((len(sheer) - 1, len(share) - 1), "paint/deck", dtype="U32")
    names[:, :-1] = hull["deck_material"]
    if "well" in hull:
        _add_well(parts, hull["well"], deck, names)
    else:
        parts.grid(deck, names)


def _add_well(parts: MeshParts, well: list[float], deck: Points, names: NDArray[np.str_]) -> None:
    """The deck around a well, and the well's floor and walls.

    Args:
        well: from x, to x, and the height of its floor.
        deck: (N, M, 3) points of the whole deck, stern to bow and middle to sheer; its outermost strip is never cut.
        names: (N - 1, M - 1) materials of the deck's cells.
    """
    start, stop, floor = well
    x = 0.5 * (deck[1:, -1, 0] + deck[:-1, -1, 0])
    rows = np.flatnonzero((x > start) & (x < stop))
    inside = np.zeros(names.shape, np.bool_)
    inside[rows, :-1] = True
    for row, column in np.argwhere(~inside):
        parts.grid(deck[row : row + 2, column : column + 2], names[row : row + 1, column : column + 1])
    edge = deck[rows[0] : rows[-1] + 2, :-1]
    sunk = edge.copy()
    sunk[..., 2] = floor
    parts.grid(sunk, "deck")
    for top, low, flip in ((edge[:, -1], sunk[:, -1], True), (edge[0], sunk[0], True), (edge[-1], sunk[-1], False)):
        parts.grid(np.stack([top, low], axis=1), "paint/well", flip=flip)


def _between(first: Points, second: Points, share: Points) -> Points:
    """(N, M, 3) points on the straight lines between two curves (N, 3)."""
    return first[:, None] + (second - first)[:, None] * share[:, None]


def add_house(parts: MeshParts, house: dict[str, Any]) -> None:
    """Add the left half of a cabin.

    Args:
        house: ``front_x``, ``rear_x``, ``half_width`` at the foot, each followed by its value at the top; ``z`` of foot
            and top, ``windows_z`` between which the glass lies, ``side_windows`` and ``front_windows`` as pairs of
            fractions along the wall (0: rear, or middle), ``rear_windows`` likewise; ``roof`` overhang to the front,
            side and rear, and its thickness; metres.
    """
    z = np.array([house["z"][0], *house["windows_z"], house["z"][1]])
    rise = (z - z[0]) / (z[-1] - z[0])
    leaning = (house[key] for key in ("front_x", "rear_x", "half_width"))
    front, rear, side = (foot + (top - foot) * rise for foot, top in leaning)
    along = _cuts(house["side_windows"])
    wall = np.empty((len(along), len(z), 3))
    wall[..., 0] = rear + (front - rear) * along[:, None]
    wall[..., 1], wall[..., 2] = side, z
    parts.grid(wall, _glazed(along, house["side_windows"], "paint/house side"), flip=True)
    for x, key, panel, flip in (
        (front, "front_windows", "paint/house front", False),
        (rear, "rear_windows", "paint/house rear", True),
    ):
        across = _cuts(house[key])
        wall = np.empty((len(across), len(z), 3))
        wall[..., 0], wall[..., 1], wall[..., 2] = x, side * across[:, None], z
        parts.grid(wall, _glazed(across, house[key], panel), flip=flip)
    ahead, aside, behind, thick = house["roof"]
    _add_roof(parts, (rear[-1] - behind, front[-1] + ahead), side[-1] + aside, z[-1], thick)


def _cuts(windows: list[list[float]]) -> Points:
    return np.unique([0.0, 1.0, *(edge for pair in windows for edge in pair)])


def _glazed(cuts: Points, windows: list[list[float]], panel: str) -> NDArray[np.str_]:
    """Materials of a wall's cells: glass in the middle of its three rows where a window is."""
    names = np.full((len(cuts) - 1, 3), panel, dtype="U32")
    middle = 0.5 * (cuts[1:] + cuts[:-1])
    for start, stop in windows:
        names[(middle > start) & (middle < stop), 1] = "glass"
    return names


def _add_roof(parts: MeshParts, x: tuple[float, float], half_width: float, z: float, thick: float) -> None:
    """A slab with bevelled edges, crowned."""
    bevel = thick / 3
    across = np.linspace(0.0, 1.0, 5)

    def ring(inset: float, height: float, crown: float = 0.0) -> Points:
        """(2, 5, 3) the slab's front and rear edge, from the middle to the left."""
        points = np.empty((2, len(across), 3))
        points[0, :, 0], points[1, :, 0] = x[1] - inset, x[0] + inset
        points[..., 1], points[..., 2] = (half_width - inset) * across, z + height + crown * (1 - across**2)
        return points

    crowned = [ring(0.0, thick - bevel, CROWN_M), ring(bevel, thick, CROWN_M)]
    rings = [ring(bevel, 0.0), ring(0.0, bevel), *crowned]
    parts.grid(np.array([np.concatenate([r[0], r[1, ::-1]]) for r in rings]), "paint/roof", flip=True)
    parts.grid(rings[-1][::-1], "paint/roof")
    parts.grid(rings[0][::-1], "dark", flip=True)


def add_rail(parts: MeshParts, sheer: Points, rail: dict[str, Any]) -> None:
    """A steel rail over the left sheer line (N, 3), between two fractions of it ``span``, on ``posts`` posts."""
    first, last = rail["span"]
    share = np.linspace(first, last, 20)
    foot = np.stack([np.interp(share, np.linspace(0, 1, len(sheer)), column) for column in sheer.T], axis=-1)
    foot[:, 1] = np.maximum(foot[:, 1] - rail["inset"], 0.0)
    top = foot + np.array([0.0, 0.0, rail["height"]])
    top[0] = foot[0]
    add_tube(parts, top, 0.016, "steel")
    for i in np.linspace(2, 18, rail["posts"]).astype(int):
        add_tube(parts, np.stack([foot[i], top[i]]), 0.012, "steel", sides=5)
