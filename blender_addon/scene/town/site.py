"""A district under construction: what has been built so far, and where there is still room."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..massing import MeshParts
from .layout import SIDE_ROAD_HALF_M, Layout, Path

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


def ribbon(
    parts: MeshParts,
    path: Path,
    material: str,
    along: tuple[float, float],
    aside: tuple[float, float],
    height: float,
    skirt: float = 0.0,
) -> None:
    """A strip of ground along a path; ``skirt`` draws its long edges down by so much."""
    pieces = max(1, math.ceil((along[1] - along[0]) / 4.0)) if path.curvature else 1
    steps = np.linspace(*along, pieces + 1)
    right, left = (path.points(steps, a, height) for a in sorted(aside))
    parts.quads(material, np.stack([right[:-1], right[1:], left[1:], left[:-1]], axis=1))
    if skirt:
        down = np.array([0.0, 0.0, skirt])
        for edge in (right, left):
            parts.quads(material, np.stack([edge[:-1] - down, edge[1:] - down, edge[1:], edge[:-1]], axis=1))
