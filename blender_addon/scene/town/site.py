"""A location: where its street runs and its vehicle stands, what has been built so far, where there is still room."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...core import clips, seeding
from ..massing import MeshParts, turned
from .tables import DISTRICTS, District

HALF_LENGTH_M = 120.0
SIDE_ROAD_HALF_M = 3.4
SHIFT_M = 50.0  # districts lie apart in the world, so that its noise differs from one to the next
BEND_RADIUS_M = (65.0, 130.0)
HEADING_JITTER_DEG = 8.0


@dataclass(frozen=True, eq=False)
class Path:
    """A middle line of constant curvature.

    Attributes:
        start: (4, 4) frame at arc length 0, x along the line and y to its left.
        curvature: 1/m, positive to the left.
    """

    start: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    curvature: float = 0.0

    def frame(self, along: float, aside: float = 0.0, turn: float = 0.0, height: float = 0.0) -> NDArray[np.float64]:
        """(4, 4) frame at arc length ``along``, shifted ``aside`` to the left, then turned; metres and radians."""
        k, angle = self.curvature, self.curvature * along
        x, y = (math.sin(angle) / k, (1 - math.cos(angle)) / k) if k else (along, 0.0)
        return self.start @ turned(angle, x, y) @ turned(turn, 0.0, aside, height)

    def points(self, along: NDArray[np.float64], aside: float, height: float) -> NDArray[np.float64]:
        """(N, 3) points beside the line."""
        return np.array([self.frame(s, aside, 0.0, height)[:3, 3] for s in along])


@dataclass(frozen=True, eq=False)
class Layout:
    """One location: its district, its street and the vehicle's place. All but ``world`` is in the district's frame.

    Attributes:
        district: its kind.
        path: the street's middle line; the vehicle is near its arc length 0.
        world: (4, 4) district to world.
        pose: (4, 4) vehicle to district.
        crossing_m: arc length at which a side road crosses; None where none does.
        sides: what stands to the right (-1) and to the left (1).
        names: name the location's random streams.
    """

    district: District
    path: Path
    world: NDArray[np.float64]
    pose: NDArray[np.float64]
    crossing_m: float | None
    sides: dict[int, str]
    names: tuple[object, ...]

    @property
    def outer_m(self) -> float:
        """From the middle line to the outer edge of the pavement."""
        return self.district.road_half_m + self.district.pavement_m

    @property
    def side_roads(self) -> list[Path]:
        """The two arms of the side road, each starting at the main road's edge."""
        if self.crossing_m is None:
            return []
        edge = self.district.road_half_m
        return [Path(self.path.frame(self.crossing_m, side * edge, side * math.pi / 2)) for side in (-1, 1)]

    def street(self) -> clips.Street:
        """The vehicle's lane, in its direction; the vehicle stands a few degrees off it."""
        k, (x, y) = self.path.curvature, self.pose[:2, 3]
        along = math.atan2(k * x, 1 - k * y) / k if k else float(x)
        aside = (1 - math.hypot(k * x, 1 - k * y)) / k if k else float(y)
        back = self.path.frame(along)[:2, 0] @ self.pose[:2, 0] < 0
        bend = k / (1 - k * aside)
        frame = self.path.frame(along, aside, math.pi if back else 0.0)
        return clips.Street(self.world @ frame, -bend if back else bend)

    def rng(self, *names: object) -> np.random.Generator:
        """A random stream of this location."""
        return seeding.named_rng(*self.names, *names)

    def from_vehicle(self, point: NDArray[np.float64]) -> float:
        """Level distance of a point (3,) of the district from the vehicle, metres."""
        return float(np.hypot(*(point[:2] - self.pose[:2, 3])))


def layout(seed: int, location: int) -> Layout:
    """The layout of a location: districts take turns, in an order that the seed shuffles."""
    order = seeding.named_rng(seed, "districts").permutation(len(DISTRICTS))
    district = DISTRICTS[order[location % len(DISTRICTS)]]
    names = (seed, "town", location)
    rng = seeding.named_rng(*names, "layout")
    shape = district.shapes[rng.integers(len(district.shapes))]
    bend = rng.choice((-1, 1)) / rng.uniform(*BEND_RADIUS_M)
    path = Path(curvature=float(bend) if shape == "bend" else 0.0)
    crossing = float(rng.choice((-1, 1)) * rng.uniform(4, 26)) if shape == "crossing" else None
    # Quarter turns only: walls and roads along the world's axes make tight bounding boxes, which saves Cycles a fifth.
    world = turned(int(rng.integers(4)) * math.pi / 2, *rng.uniform(-SHIFT_M, SHIFT_M, 2))
    side = int(rng.choice((-1, 1)))
    lane_m = district.road_half_m / district.lanes
    lane = rng.integers(district.lanes)
    aside = side * (lane_m * (lane + 0.5) + rng.uniform(-0.3, 0.3))
    if district.lines == "bays":
        aside = side * rng.uniform(0.25, 0.4) * district.road_half_m
    heading = math.radians(rng.uniform(-1, 1) * HEADING_JITTER_DEG) + (0.0 if side < 0 else math.pi)  # on the right
    pose = path.frame(rng.uniform(-2, 2), aside, heading)
    left, right = (district.sides[i] for i in rng.permutation(len(district.sides))[:2])
    return Layout(district, path, world, pose, crossing, {1: left, -1: right}, names)


PAVED_M = 0.12  # height of the pavement above the road
VEHICLE_ROOM_M = 4.5  # nothing stands nearer to the vehicle's middle


@dataclass(eq=False)
class Site:
    """Where the builders put things, all in the district's frame.

    Attributes:
        layout: what is being built.
        parts: ground, buildings and furniture: one mesh.
        trees: (kind, frame) of each tree, its scale in the frame.
        lamps: (4, 4) frames of lamp heads, shining down.
        taken: (x, y, radius) of what stands about.
    """

    layout: Layout
    parts: MeshParts = field(default_factory=MeshParts)
    trees: list[tuple[str, NDArray[np.float64]]] = field(default_factory=list)
    lamps: list[NDArray[np.float64]] = field(default_factory=list)
    taken: list[tuple[float, float, float]] = field(default_factory=list)

    def ground_m(self, aside: float) -> float:
        """Height of the ground beside the main road's middle line."""
        kerbed = self.layout.district.pavement_m > 0 and abs(aside) > self.layout.district.road_half_m
        return PAVED_M if kerbed else 0.0

    def frame(self, along: float, aside: float, turn: float = 0.0) -> NDArray[np.float64]:
        """(4, 4) frame on the ground beside the main road."""
        return self.layout.path.frame(along, aside, turn, self.ground_m(aside))

    def claim(self, frame: NDArray[np.float64], radius: float, length: float = 0.0) -> bool:
        """Take a round place, or an oblong one ``length`` long along the frame's x and twice ``radius`` wide, if free.

        False when something, or the vehicle, stands there.
        """
        count = max(1, math.ceil(length / (2 * radius)))
        shifts = np.linspace(-0.5, 0.5, count) * max(length - 2 * radius, 0.0) if count > 1 else np.zeros(1)
        spots = frame[:3, 3] + shifts[:, None] * frame[:3, 0]
        radius *= math.sqrt(2.0) if count > 1 else 1.0  # circles around the squares that make up an oblong
        for spot in spots:
            if self.layout.from_vehicle(spot) < VEHICLE_ROOM_M + radius:
                return False
            if any(math.hypot(spot[0] - x, spot[1] - y) < radius + r for x, y, r in self.taken):
                return False
        self.taken += [(float(x), float(y), radius) for x, y, _ in spots]
        return True

    def clear_of_crossing(self, along: float, margin: float = 2.0) -> bool:
        """True where the main road's sides are not cut by the side road."""
        crossing = self.layout.crossing_m
        return crossing is None or abs(along - crossing) > SIDE_ROAD_HALF_M + margin

    def stretches(self, half_length: float, gap: float) -> list[tuple[float, float]]:
        """Stretches of the main road's sides, cut open by ``gap`` on each side of the side road's middle."""
        crossing = self.layout.crossing_m
        if crossing is None:
            return [(-half_length, half_length)]
        return [(-half_length, crossing - gap), (crossing + gap, half_length)]

    def lay(
        self,
        material: str,
        along: tuple[float, float],
        aside: tuple[float, float],
        height: float,
        skirt: float = 0.0,
        path: Path | None = None,
    ) -> None:
        """A strip of ground along a path, by default the main road; ``skirt`` draws its long edges down by so much."""
        path = path or self.layout.path
        pieces = max(1, math.ceil((along[1] - along[0]) / 4.0)) if path.curvature else 1
        steps = np.linspace(*along, pieces + 1)
        right, left = (path.points(steps, a, height) for a in sorted(aside))
        self.parts.quads(material, np.stack([right[:-1], right[1:], left[1:], left[:-1]], axis=1))
        if skirt:
            down = np.array([0.0, 0.0, skirt])
            for edge in (right, left):
                self.parts.quads(material, np.stack([edge[:-1] - down, edge[1:] - down, edge[1:], edge[:-1]], axis=1))
