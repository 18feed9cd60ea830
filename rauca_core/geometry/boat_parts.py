"""What is fitted to a boat: rails, mast, seats, outboard engine, and the blocks below it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .mesh import MeshParts
from .solids import add_box, add_tube, turned_along_x

Points = NDArray[np.float64]


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


def add_mast(parts: MeshParts, mast: dict[str, Any]) -> None:
    """A mast with a crosstree, a radar's dome on a bracket before it, and a lamp on top."""
    x = mast["x"]
    low, high = mast["z"]
    add_tube(parts, np.array([[x, 0, low], [x, 0, high]]), 0.032, "steel", sides=10)
    arm = low + 0.62 * (high - low)
    add_box(parts, (x, 0, arm), (0.04, 0.9, 0.03), "steel", 0.008)
    dome = np.array([[0.0, -0.09], [0.17, -0.08], [0.20, -0.02], [0.18, 0.05], [0.10, 0.09], [0.0, 0.10]])
    upright = turned_along_x(dome, 20, (0.0, 0.0, 0.0))[..., [2, 1, 0]] * [-1, 1, 1]
    bracket = low + 0.45 * (high - low)
    parts.grid(upright + np.array([x + 0.24, 0, bracket]), "paint/dome")
    add_box(parts, (x + 0.12, 0, bracket - 0.11), (0.30, 0.10, 0.03), "steel", 0.008)
    add_box(parts, (x, 0, high + 0.04), (0.06, 0.06, 0.09), "seat", 0.015)
    for side in (-1, 1):
        add_tube(parts, np.array([[x, side * 0.40, arm], [x - 0.06, side * 0.43, arm + 0.6]]), 0.006, "dark", sides=4)


def add_seats(parts: MeshParts, seats: list[list[float]]) -> None:
    """Padded boxes: center and size of each; metres."""
    for x, y, z, length, width, height in seats:
        add_box(parts, (x, y, z), (length, width, height), "seat", 0.04)


def add_engine(parts: MeshParts, engine: dict[str, Any]) -> None:
    """An outboard engine behind the transom: hood, leg, plate and propeller."""
    x, top = engine["x"], engine["top_z"]
    add_box(parts, (x, 0, top - 0.26), (0.58, 0.40, 0.52), "engine", 0.12)
    add_box(parts, (x + 0.005, 0, top - 0.17), (0.60, 0.405, 0.035), "steel", 0.01)
    add_box(parts, (x, 0, top - 0.78), (0.26, 0.14, 0.60), "engine", 0.05)
    add_box(parts, (x - 0.08, 0, top - 0.98), (0.48, 0.24, 0.025), "engine", 0.01)
    gear = np.array([[0.0, -0.22], [0.06, -0.16], [0.075, 0.0], [0.05, 0.16], [0.0, 0.22]])
    parts.grid(turned_along_x(gear, 14, (x, 0.0, top - 1.14)), "engine")
    for turn in range(3):
        angle = 2 * np.pi * turn / 3 + np.pi / 2
        tip = np.array([x - 0.26, 0.15 * np.cos(angle), top - 1.14 + 0.15 * np.sin(angle)])
        add_box(parts, tuple(tip), (0.03, 0.12, 0.12), "steel", 0.05)


def add_cradle(parts: MeshParts, cradle: dict[str, Any], x: float) -> None:
    """The left half of one frame that holds the hull: a beam on the ground under the keel, and a padded post."""
    width, post_y, post_z = cradle["half_width"], cradle["post_y"], cradle["post_z"]
    keel = cradle["keel_z"]
    add_box(parts, (x, width / 2, keel / 2), (0.16, width, keel), "wood", 0.01)
    add_box(parts, (x, post_y, (keel + post_z) / 2), (0.10, 0.10, post_z - keel), "wood", 0.01)
    add_box(parts, (x, post_y - 0.04, post_z), (0.34, 0.16, 0.06), "rubber", 0.015)
