"""Which material each cell of a car's skin has, and which body panel each painted cell belongs to.

A painted cell is named ``paint/<panel>``; a panel becomes one chart of the UV atlas, cut where a real car has its shut
lines or its edges.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .car_body import Body
from .mesh import MeshParts

Names = NDArray[np.str_]
GLASS_LINES = (2, 5)  # of the deck: the side windows lie between these
SCREEN_LINE = 7  # the screens lie inside this line


def add_skin(parts: MeshParts, body: Body) -> None:
    """Add the left half of the body's skin and its floor."""
    wall = body.wall_points()
    parts.grid(wall, _wall_materials(body, wall))
    parts.grid(body.deck_points(wall[:, -1]), _deck_materials(body))
    edge = wall[:, 0]
    parts.grid(np.stack([edge * [1, 0, 1], edge], axis=1), "underbody")


def _wall_materials(body: Body, wall: NDArray[np.float64]) -> Names:
    """(columns - 1, rows - 1) material of each cell of the wall with vertices ``wall`` (columns, rows, 3)."""
    features, columns = body.profile["features"], body.columns
    splits = np.array(body.profile["wall"]["splits"])
    row = np.repeat(np.arange(len(splits)), splits)[None, :]
    step = np.concatenate([np.arange(n) for n in splits])[None, :]
    count = len(columns.top) - 1
    index = np.arange(count)[:, None]
    nose, tail = index < columns.front - 1, index >= count - (columns.rear - 1)
    place = 0.5 * (columns.top[1:] + columns.top[:-1])[:, None]
    lamps = body.place_of_x(np.array([features["headlamp_to_x"], features["taillamp_to_x"]]))
    y = 0.5 * (wall[1:, -1, 1] + wall[:-1, -1, 1])[:, None]
    names = np.full((count, row.shape[1]), "paint/", dtype="U32")
    for panel, here in _side_panels(body, place).items():
        names[np.broadcast_to(here, names.shape)] = "paint/" + panel
    names[np.broadcast_to(nose, names.shape)] = "paint/nose"
    names[np.broadcast_to(tail, names.shape)] = "paint/tail"
    names[np.broadcast_to(row == 0, names.shape)] = "trim"
    names[(row == 1) & nose & (y < features["front_intake_y"])] = "trim"
    names[(row == 1) & tail & (y < features["rear_intake_y"])] = "trim"
    names[(row == 3) & tail] = "gap"
    names[(row >= 4) & (row <= 5) & nose & (y < features["grille_y"])] = "grille"
    head = (row == 5) & (place < lamps[0]) & ~(nose & (y < features["headlamp_y"]))
    names[head] = "lens"
    names[head & (step == 1)] = "headlamp"
    rear = (row == 5) & (place > lamps[1]) & ~(tail & (y < features["taillamp_y"]))
    names[rear] = "taillamp"
    inner, outer = features["reverse_lamp_y"]
    names[rear & tail & (y < inner)] = "gap"
    names[rear & tail & (step == 0) & (y > inner) & (y < outer)] = "reverse"
    names[(row > 0) & _is_gap(body, columns.top, features["door_gaps"])[:, None]] = "gap"
    return names


def _deck_materials(body: Body) -> Names:
    """(stations - 1, lines - 1) material of each cell of the deck."""
    features = body.profile["features"]
    x = body.side_x()
    middle = 0.5 * (x[1:] + x[:-1])[:, None]
    lines = len(body.profile["deck"]["flat_width"]) - 1
    line = np.arange(lines)[None, :]

    def between(pair: list[float]) -> NDArray[np.bool_]:
        return (middle < pair[0]) & (middle > pair[1])

    screen, window = features["windscreen"], features["rear_window"]
    names = np.full((len(x) - 1, lines), "paint/roof", dtype="U32")
    names[np.broadcast_to(middle > features["bonnet_gap"] - 1e-6, names.shape)] = "paint/bonnet"
    names[np.broadcast_to(middle < features["boot_gap"] + 1e-6, names.shape)] = "paint/boot"
    names[between([features["bonnet_gap"], screen[1]]) & (line < SCREEN_LINE)] = "paint/front pillar"
    names[between([window[0], features["boot_gap"]]) & (line < SCREEN_LINE)] = "paint/rear pillar"
    names[between([window[1], features["boot_gap"]]) & (line >= SCREEN_LINE)] = "paint/boot"
    tailgate = features["boot_gap"] > window[0]
    if tailgate:  # it carries the rear window, the pillars stand beside it
        names[(middle < features["boot_gap"]) & (line < SCREEN_LINE)] = "paint/rear pillar"
    # A panelled side is door and quarter up to the roof; elsewhere those end below the windows.
    side = np.where(middle < features["panelled_from"], GLASS_LINES[1], GLASS_LINES[0])
    for panel, here in _side_panels(body, body.place_of_x(middle)).items():
        names[here & (line < side)] = "paint/" + panel
    names[_is_gap(body, body.place_of_x(x), features["door_gaps"])[:, None] & (line < side)] = "gap"
    glazed = (line >= GLASS_LINES[0]) & (line < GLASS_LINES[1])
    names[between(features["side_glass"]) & glazed] = "glass"
    for pillar in features["pillars"]:
        names[between(pillar) & glazed] = "trim"
    for pane in (screen, window):
        names[between(pane) & (line >= SCREEN_LINE)] = "glass"
    names[between([features["bonnet_gap"], screen[0]]) & (line >= SCREEN_LINE)] = "trim"
    for gap, edge in ((features["bonnet_gap"], 4), (features["boot_gap"], SCREEN_LINE if tailgate else 4)):
        names[(np.abs(middle - gap) < 0.002) & (line >= edge)] = "gap"
    return names


def _side_panels(body: Body, place: NDArray[np.float64]) -> dict[str, NDArray[np.bool_]]:
    """Where each side panel lies among places along the outline."""
    first, second, third = body.place_of_x(np.array(body.profile["features"]["door_gaps"]))
    return {
        "wing": place < first,
        "front door": (place > first) & (place < second),
        "rear door": (place > second) & (place < third),
        "quarter": place > third,
    }


def _is_gap(body: Body, places: NDArray[np.float64], gaps: list[float]) -> NDArray[np.bool_]:
    """(columns - 1,) True between the two columns that border a shut line."""
    middle = 0.5 * (places[1:] + places[:-1])
    return (np.abs(middle[:, None] - body.place_of_x(np.array(gaps))) < 0.002).any(axis=1)
