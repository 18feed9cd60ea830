"""The procedural motor boats, on the blocks they stand on ashore: profile tables in, an unwrapped vehicle out."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contract import Vehicle
from ..contract.assets import assets_folder
from .assemble import assemble
from .boat_parts import add_cradle, add_engine, add_mast, add_rail, add_seats
from .curves import curve_through
from .house import add_house
from .materials import BOAT
from .mesh import MeshParts

BOATS = ("boat", "boat_detailed")
CENTRAL_PANELS = ("deck", "transom", "roof", "house front", "house rear")
Points = NDArray[np.float64]


def build_boat(name: str) -> Vehicle:
    """Build and unwrap the boat of ``assets/vehicles/<name>.toml``; deterministic."""
    text = (assets_folder() / "vehicles" / f"{name}.toml").read_text(encoding="utf-8")
    profile = tomllib.loads(text)
    half = MeshParts()
    sheer = _add_hull(half, profile["hull"])
    for house in profile.get("houses", []):
        add_house(half, house)
    for rail in profile.get("rails", []):
        add_rail(half, sheer, rail)
    for x in profile["cradle"]["x"]:
        add_cradle(half, profile["cradle"], x)
    whole = MeshParts()
    whole.extend(half)
    whole.extend(half.mirrored())
    _add_central(whole, profile)
    source = f"rauca procedural {name} (assets/vehicles/{name}.toml)"
    return assemble(name, "boat", whole, BOAT, source, CENTRAL_PANELS)


def _add_central(parts: MeshParts, profile: dict[str, Any]) -> None:
    """What stands on the middle line."""
    adders: dict[str, Callable[[MeshParts, Any], None]] = {"engine": add_engine, "mast": add_mast, "seats": add_seats}
    for name, add in adders.items():
        if name in profile:
            add(parts, profile[name])


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
