"""A car's body: a wall around the plan outline, and a deck (bonnet, cabin, boot) across its top.

Both are grids that share their edge, so the skin has no cracks, and the lines of the grids run along the features
(lamps, doors, glass), so materials have crisp borders. A painted cell is
named ``paint/<panel>``; a panel becomes one chart of the UV atlas, cut where a real car has its shut lines or its
edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .mesh import Mask, MeshParts, Points
from .solids import half_outline, monotone_curve, smoothstep

ROWS = ("sill", "skirt", "intake", "bumper", "gap", "lamp_low", "lamp_high")
ARCH_FAN_M = 0.025  # the columns over a wheel arch spread by this much from the arch to the belt


@dataclass(frozen=True, eq=False)
class Columns:
    """The wall's columns, from the nose's middle along the left side to the tail's middle.

    Attributes:
        top, bottom: (N,) places along the outline of both ends of a column, metres.
        floor: (N,) height of its lower end.
        front, rear: number of columns on the nose and on the tail, corner columns included.
    """

    top: Points
    bottom: Points
    floor: Points
    front: int
    rear: int


class CarBody:
    """The left half of the body as grids of points, built from the profile tables."""

    def __init__(self, profile: dict[str, Any]) -> None:
        self.profile = profile
        self.wall_table = {k: np.array(profile["wall"][k]) for k in ("front", "side", "rear")}
        self.deck_table = {k: np.array(v) for k, v in profile["deck"].items()}
        self._outline = half_outline(np.array(profile["plan"]["outline"]))
        steps = np.linalg.norm(np.diff(self._outline, axis=0), axis=1)
        self._place = np.concatenate([[0.0], np.cumsum(steps)])
        tangent = np.gradient(self._outline, self._place, axis=0)
        self._normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1) * -1.0
        self.columns = self._columns()

    def wall_points(self) -> Points:
        """(columns, rows, 3) vertices of the wall."""
        columns, splits = self.columns, self.profile["wall"]["splits"]
        lines = np.stack([*(self._row(name, columns.top) for name in ROWS), self._top_row()], axis=1)
        fraction = (lines - lines[:, :1]) / (lines[:, -1:] - lines[:, :1])
        pieces = [
            fraction[:, i : i + 1] + (fraction[:, i + 1 : i + 2] - fraction[:, i : i + 1]) * np.arange(n) / n
            for i, n in enumerate(splits)
        ]
        fraction = np.concatenate([*pieces, fraction[:, -1:]], axis=1)
        z = columns.floor[:, None] + (lines[:, -1] - columns.floor)[:, None] * fraction
        return self.skin(columns.bottom[:, None] + (columns.top - columns.bottom)[:, None] * fraction, z)

    def deck_points(self, edge: Points) -> Points:
        """(stations, lines, 3) vertices of the deck inside the wall's upper edge (N, 3)."""
        columns, table = self.columns, self.deck_table
        front, rear = columns.front, columns.rear
        side = edge[front - 1 : len(edge) - rear + 1]
        nose, tail = edge[:front][::-1], edge[len(edge) - rear :]
        x = self.side_x()
        height = monotone_curve(table["top"], x) - side[:, 2]
        cabin = np.clip((height - table["cabin_height"][0]) / np.ptp(table["cabin_height"]), 0, 1)[:, None]
        width = (1 - cabin) * table["flat_width"] + cabin * table["roof_width"]
        rise = (1 - cabin) * table["flat_height"] + cabin * table["roof_height"]
        # Near the ends the stations bow until the last one lies on the nose, and the first on the tail.
        plan = self.profile["plan"]
        ahead = smoothstep(x, plan["front_bow_x"], plan["front_corner_x"])[:, None]
        behind = smoothstep(-x, -plan["rear_bow_x"], -plan["rear_corner_x"])[:, None]
        low = 1 - cabin  # a roof that reaches far to the front or rear keeps its own section
        width = width + low * (ahead * (nose[:, 1] / nose[0, 1] - width) + behind * (tail[:, 1] / tail[0, 1] - width))
        bow = ahead * (nose[:, 0] - nose[0, 0]) + behind * (tail[:, 0] - tail[0, 0])
        return np.stack([side[:, :1] + bow, width * side[:, 1:2], side[:, 2:] + height[:, None] * rise], axis=-1)

    def skin(self, place: Points, z: Points) -> Points:
        """Points of the wall (..., 3) by place along the outline and height: outline + normal * offset(facing, z)."""
        xy, normal = self._at(place, self._outline), self._at(place, self._normal)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        offset = {k: monotone_curve(v, z) for k, v in self.wall_table.items()}
        ahead, aside = normal[..., 0] ** 2, normal[..., 1] ** 2
        along = np.where(normal[..., 0] > 0, offset["front"], offset["rear"])
        xy = xy + normal * (ahead * along + aside * offset["side"])[..., None]
        xy[..., 1] = np.where(xy[..., 1] < 1e-6, 0.0, xy[..., 1])
        return np.concatenate([xy, z[..., None]], axis=-1)

    def _at(self, place: Points, values: Points) -> Points:
        """(..., 2) of what the outline has at each of its own points (N, 2)."""
        return np.stack([np.interp(place, self._place, column) for column in values.T], axis=-1)

    def ribbon(self, places: tuple[float, float], heights: tuple[float, float], lift: float) -> Points:
        """Vertices of a strip that stands ``lift`` metres proud of the wall, between two places and two heights."""
        count = max(2, int(abs(places[1] - places[0]) / 0.04))
        place = np.repeat(np.linspace(*places, count + 1)[:, None], 4, axis=1)
        edge = min(0.3 * (heights[1] - heights[0]), lift)
        z = np.tile([heights[0], heights[0] + edge, heights[1] - edge, heights[1]], (count + 1, 1))
        points = self.skin(place, z)
        points[..., :2] += self._at(place, self._normal) * (np.array([-0.004, lift, lift, -0.004]))[:, None]
        points[..., 1] = np.where(place == 0.0, 0.0, points[..., 1])
        return points

    def deck_line(self, line: int) -> Points:
        """(stations, 3) points along a line of the deck, front to rear; 0 is the belt."""
        return self.deck_points(self.wall_points()[:, -1])[:, line]

    @property
    def tail_place(self) -> float:
        """Place of the tail's middle; the nose's is 0."""
        return float(self._place[-1])

    def place_of_x(self, x: Points) -> Points:
        """Places along the outline of the side's points by x."""
        side = slice(*np.searchsorted(-self._outline[:, 0], [-self._outline[8, 0], -self._outline[-8, 0]]))
        return np.interp(-x, -self._outline[side, 0], self._place[side])

    def _columns(self) -> Columns:
        plan, wheels = self.profile["plan"], self.profile["wheels"]
        corners = self.place_of_x(np.array([plan["front_corner_x"], plan["rear_corner_x"]]))
        front = np.array(plan["front_columns"][:0:-1]) * corners[0]
        end = self._place[-1]
        rear = end - np.array(plan["rear_columns"][1:]) * (end - corners[1])
        x = self.side_x()
        bottom_x, floor = x.copy(), np.full(len(x), np.nan)
        radius, hub = wheels["arch_radius"], wheels["radius"]
        for center in (wheels["front_x"], wheels["rear_x"]):
            reach = np.abs(x - center)
            fan, leg, free = radius + ARCH_FAN_M, radius + 2 * ARCH_FAN_M, radius + 6 * ARCH_FAN_M
            sign = np.sign(x - center)
            low = np.interp(reach, [fan, leg, free], [radius, radius + 0.4 * ARCH_FAN_M, free])
            bottom_x = np.where((reach > fan) & (reach < free), center + sign * low, bottom_x)
            over = reach <= fan
            bottom_x = np.where(over, center + (x - center) * radius / fan, bottom_x)
            rise = np.sqrt(np.clip(radius**2 - (bottom_x - center) ** 2, 0, None))
            floor = np.where(over, hub + rise, floor)
            floor = np.where((reach > fan) & (reach < leg), hub + (reach - fan) / (leg - fan) * (0.2 - hub), floor)
        places, low_places = self.place_of_x(x), self.place_of_x(bottom_x)
        top = np.concatenate([front, places, rear])
        bottom = np.concatenate([front, low_places, rear])
        sill = self._row("sill", top)
        floor = np.concatenate([np.full(len(front), np.nan), floor, np.full(len(rear), np.nan)])
        return Columns(
            top, bottom, np.fmax(np.where(np.isnan(floor), sill, floor), sill), len(front) + 1, len(rear) + 1
        )

    def side_x(self) -> Points:
        """x of the side's columns, front to rear: features exactly, arches densely, the rest evenly."""
        plan, features, wheels = self.profile["plan"], self.profile["features"], self.profile["wheels"]
        half = features["gap"] / 2
        shut = [*features["door_gaps"], features["bonnet_gap"], features["boot_gap"]]
        wanted = [x + side for x in shut for side in (-half, half)]
        wanted += [*features["windscreen"], *features["rear_window"], *features["side_glass"]]
        wanted += [x for pair in features["pillars"] for x in pair]
        wanted += [features["headlamp_to_x"], features["taillamp_to_x"], plan["front_corner_x"], plan["rear_corner_x"]]
        fan = wheels["arch_radius"] + ARCH_FAN_M
        arch = [np.cos(np.linspace(0, np.pi, 21)) * fan, [-fan - ARCH_FAN_M, fan + ARCH_FAN_M]]
        filling = [c + d for c in (wheels["front_x"], wheels["rear_x"]) for d in np.concatenate(arch)]
        count = int((plan["front_corner_x"] - plan["rear_corner_x"]) / features["column_spacing"])
        even = np.linspace(plan["rear_corner_x"], plan["front_corner_x"], count)
        filling_array = np.array(filling)
        even = even[np.abs(even[:, None] - filling_array).min(axis=1) > 0.03]
        for x in [*filling, *even]:
            if np.abs(np.array(wanted) - x).min() > (0.003 if x in filling else 0.018):
                wanted.append(x)
        return np.sort(np.array(wanted))[::-1]

    def _row(self, name: str, place: Points) -> Points:
        """Height of a feature row along the outline."""
        plan, wheels = self.profile["plan"], self.profile["wheels"]
        x = np.array([plan["front_corner_x"], wheels["front_x"], 0.0, wheels["rear_x"], plan["rear_corner_x"]])
        side = self.place_of_x(x)
        end = self._place[-1]
        keys = np.concatenate([[0.0, 0.5 * side[0]], side, [end - 0.45 * (end - side[-1]), end]])
        return monotone_curve(np.stack([keys, self.profile["wall"]["row_" + name]], axis=1), place)

    def _top_row(self) -> Points:
        """Height of the wall's upper edge: the belt on the sides, the deck's end on nose and tail."""
        columns = self.columns
        side = self.side_x()
        belt = monotone_curve(self.deck_table["belt"], side)
        top = monotone_curve(self.deck_table["top"], side)
        shape = self.deck_table["flat_height"][1:]
        front = belt[0] + (top[0] - belt[0]) * shape[::-1]
        rear = belt[-1] + (top[-1] - belt[-1]) * shape
        assert len(front) == columns.front - 1
        return np.concatenate([front, belt, rear])


Names = NDArray[np.str_]
GLASS_LINES = (2, 5)  # of the deck: the side windows lie between these
SCREEN_LINE = 7  # the screens lie inside this line


def add_skin(parts: MeshParts, body: CarBody) -> None:
    """Add the left half of the body's skin and its floor."""
    wall = body.wall_points()
    parts.grid(wall, _wall_materials(body, wall))
    parts.grid(body.deck_points(wall[:, -1]), _deck_materials(body))
    edge = wall[:, 0]
    parts.grid(np.stack([edge * [1, 0, 1], edge], axis=1), "underbody")


def _wall_materials(body: CarBody, wall: Points) -> Names:
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
        np.copyto(names, "paint/" + panel, where=here)
    np.copyto(names, "paint/nose", where=nose)
    np.copyto(names, "paint/tail", where=tail)
    np.copyto(names, "trim", where=row == 0)
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


def _deck_materials(body: CarBody) -> Names:
    """(stations - 1, lines - 1) material of each cell of the deck."""
    features = body.profile["features"]
    x = body.side_x()
    middle = 0.5 * (x[1:] + x[:-1])[:, None]
    lines = len(body.profile["deck"]["flat_width"]) - 1
    line = np.arange(lines)[None, :]

    def between(pair: list[float]) -> Mask:
        return (middle < pair[0]) & (middle > pair[1])

    screen, window = features["windscreen"], features["rear_window"]
    names = np.full((len(x) - 1, lines), "paint/roof", dtype="U32")
    np.copyto(names, "paint/bonnet", where=middle > features["bonnet_gap"] - 1e-6)
    np.copyto(names, "paint/boot", where=middle < features["boot_gap"] + 1e-6)
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


def _side_panels(body: CarBody, place: Points) -> dict[str, Mask]:
    """Where each side panel lies among places along the outline."""
    first, second, third = body.place_of_x(np.array(body.profile["features"]["door_gaps"]))
    return {
        "wing": place < first,
        "front door": (place > first) & (place < second),
        "rear door": (place > second) & (place < third),
        "quarter": place > third,
    }


def _is_gap(body: CarBody, places: Points, gaps: list[float]) -> Mask:
    """(columns - 1,) True between the two columns that border a shut line."""
    middle = 0.5 * (places[1:] + places[:-1])
    return (np.abs(middle[:, None] - body.place_of_x(np.array(gaps))) < 0.002).any(axis=1)
