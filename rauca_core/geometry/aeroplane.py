"""The procedural aeroplane, on its wheels: a profile table in, an unwrapped vehicle out."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contract import Vehicle
from .assemble import assemble, read_profile
from .mesh import Indices, Mask, MeshParts, Points
from .solids import add_box, add_solids, add_tube, lathe, monotone_curve

AEROPLANES = ("aeroplane",)
RING = 24  # faces of half the fuselage's girth, window edges apart
# Along a wing's section: fractions of the chord, dense where it is round; the flaps' gap lies between two of them.
CHORD = np.array([0.0, 0.012, 0.05, 0.11, 0.2, 0.32, 0.46, 0.6, 0.730, 0.738, 0.87, 1.0])
BAY_M = 0.4
FLAPPED_BAYS = 2
FLAP_GAP = 8  # the cell of CHORD that is the gap


def build_aeroplane(name: str) -> Vehicle:
    """Build and unwrap the aeroplane of ``assets/vehicles/<name>.toml``; deterministic."""
    profile = read_profile(name)
    half = MeshParts()
    _add_fuselage(half, profile["fuselage"])
    add_wing(half, np.array(profile["wing"]), "wing")
    add_wing(half, np.array(profile["tailplane"]), "tailplane")
    _add_engine(half, profile["engine"])
    _add_wheel(half, profile["gear"]["main"])
    whole = half.both_sides()
    add_wing(whole, np.array(profile["fin"]), "fin")
    _add_wheel(whole, profile["gear"]["nose"])
    return assemble(name, "airplane", whole)


def _add_fuselage(parts: MeshParts, fuselage: dict[str, Any]) -> None:
    """The left half of the skin with its windows; angles run from the belly over the side to the top."""
    table = np.array(fuselage["sections"])
    windows, screens = fuselage["windows"], fuselage["screens"]
    edges = [*(x for pair in windows["x"] for x in pair), *screens["x"]]
    even = [x for x in fuselage["stations"] if np.abs(np.array(edges) - x).min() > 0.04]
    x = np.sort(np.array([*edges, *even]))
    marks = [*windows["angle"], *(a for pair in screens["angles"] for a in pair)]
    level = [a for a in np.linspace(0, 180, RING + 1) if np.abs(np.array(marks) - a).min() > 2.5 or a in (0, 180)]
    angle = np.unique([*marks, *level])
    wide, high, middle = (monotone_curve(table[:, [0, i]], x)[:, None] for i in (1, 2, 3))
    turn = np.radians(angle)
    points = np.empty((len(x), len(angle), 3))
    points[..., 0] = x[:, None]
    points[..., 1] = np.where(np.isin(angle, (0, 180)), 0.0, wide * np.sin(turn))
    points[..., 2] = middle - high * np.cos(turn)
    parts.grid(points, _fuselage_materials(fuselage, x, angle), flip=True)


def _fuselage_materials(fuselage: dict[str, Any], x: Points, angle: Points) -> NDArray[np.str_]:
    """(stations - 1, angles - 1) material of each cell of the skin."""
    at, around = 0.5 * (x[1:] + x[:-1])[:, None], 0.5 * (angle[1:] + angle[:-1])
    part = np.searchsorted(np.array(fuselage["panels_x"]), at)
    names = np.repeat(np.array(["paint/tail", "paint/cabin", "paint/nose"])[part], len(around), axis=1)

    def between(values: Points, pair: list[float]) -> Mask:
        return (values > pair[0]) & (values < pair[1])

    windows, screens = fuselage["windows"], fuselage["screens"]
    for pair in windows["x"]:
        names[between(at, pair) & between(around, windows["angle"])] = "glass"
    for pair in screens["angles"]:
        names[between(at, screens["x"]) & between(around, pair)] = "glass"
    return names


def add_wing(parts: MeshParts, sections: Points, panel: str) -> None:
    """A wing from its root to its tip, closed at the tip.

    Args:
        sections: (N, 5) leading edge x, y, z, chord and thickness over chord, metres.
    """
    sections, bay = _filled(sections)
    span = np.gradient(sections[:, 1:3], axis=0)
    span /= np.linalg.norm(span, axis=1, keepdims=True)
    up = np.stack([-span[:, 1], span[:, 0]], axis=1)
    half = 5 * (0.2969 * CHORD**0.5 - 0.1260 * CHORD - 0.3516 * CHORD**2 + 0.2843 * CHORD**3 - 0.1036 * CHORD**4)
    around = np.concatenate([CHORD[::-1], CHORD[1:]])
    lift = np.concatenate([-0.7 * half[::-1], half[1:]])  # flatter below than above
    lift[[0, -1]] = 0.0
    closed = np.vstack([sections, sections[-1:] * [1, 1, 1, 1, 0]])
    up = np.vstack([up, up[-1:]])
    chord, thickness = closed[:, 3:4], closed[:, 4:5]
    points = np.empty((len(closed), len(around), 3))
    points[..., 0] = closed[:, :1] - chord * around
    points[..., 1:] = closed[:, None, 1:3] + (chord * thickness * lift)[..., None] * up[:, None]
    # The upper and lower side of each bay between two given sections is a panel; flaps end before the tips.
    side = np.where(np.arange(len(around) - 1) < len(CHORD) - 1, "below", "above")
    names = np.char.add(np.char.add(f"paint/{panel} ", bay.astype(str))[:, None], np.char.add(" ", side))
    under, over = len(CHORD) - 2 - FLAP_GAP, len(CHORD) - 1 + FLAP_GAP
    for column in (under, over):
        names[bay < FLAPPED_BAYS, column] = "gap"
    parts.grid(points, names)


def _filled(sections: Points) -> tuple[Points, Indices]:
    """Sections at most ``BAY_M`` apart, and the given bay that each of their gaps, and the tip, belongs to."""
    rows, bay = [sections[:1]], []
    for i, (here, there) in enumerate(pairwise(sections)):
        count = int(np.ceil(np.linalg.norm((there - here)[:3]) / BAY_M))
        rows.append(here + (there - here) * (np.arange(1, count + 1) / count)[:, None])
        bay += [i] * count
    return np.vstack(rows), np.array([*bay, bay[-1]])


def _add_engine(parts: MeshParts, engine: dict[str, Any]) -> None:
    """A turbofan in its nacelle, on a short pylon."""
    add_solids(parts, engine["nacelle"])
    hub = np.array(engine["center"]) + np.array([0.41, 0.0, 0.0])
    for blade in range(12):
        turn = 2 * np.pi * blade / 12
        out = np.array([0.0, np.cos(turn), np.sin(turn)])
        lean = np.array([0.05, -0.035 * np.sin(turn), 0.035 * np.cos(turn)])
        root, tip = hub + 0.07 * out, hub + 0.245 * out
        parts.grid(np.array([[root - lean / 2, root + lean / 2], [tip - lean, tip + lean]]), "steel")
    add_solids(parts, engine["pylon"])


def _add_wheel(parts: MeshParts, gear: dict[str, Any]) -> None:
    """A wheel on its leg: hub, leg top, radius and width in metres."""
    x, y = gear["place"]
    radius, half = gear["radius"], gear["width"] / 2
    outline = [[0.0, -0.8], [0.55, -0.8], [0.60, -1.0], [0.85, -1.0], [1.0, -0.6], [1.0, 0.6], [0.85, 1.0], [0.60, 1.0]]
    outline += [[0.55, 0.8], [0.0, 0.8]]
    ring = lathe(np.array(outline) * [radius, half], 28) + np.array([x, y, radius])
    names = np.full((28, len(outline) - 1), "tyre", dtype="U32")
    names[:, [0, 1, -2, -1]] = "steel"
    parts.grid(ring, names, flip=True)
    side = y - half - 0.035
    add_tube(parts, np.array([[x, side, radius], [x, side, gear["top"]]]), 0.03, "steel", sides=8)
    add_box(parts, (x, side + 0.03, radius), (0.06, 0.10, 0.06), "steel", 0.01)
