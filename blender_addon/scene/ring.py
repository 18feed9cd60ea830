"""The camera ring as lines to draw. NumPy only."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core import contract, viewpoints

Segments = NDArray[np.float32]  # (N, 2, 3) world space, metres

CIRCLE_STEPS, EDGE_STEPS = 72, 6
MOST_CAMERAS = 400  # drawn; of more, every n-th
MOST_RANGES = 48  # with more cameras only the chosen one shows how far it may stray
CAMERA_SIZE, CHOSEN_SIZE = 0.04, 0.12  # length of a drawn camera over its distance
NONE = np.zeros((0, 2, 3))


@dataclass(frozen=True, eq=False)
class RingLines:
    """What is drawn, each in a color of its own.

    Attributes:
        circles: the rings, without jitter.
        ranges: edges of the space that jitter leaves each camera.
        cameras: small frusta where the data set's cameras stand, jitter included.
        chosen: the chosen view's frustum and its line of sight.
    """

    circles: Segments
    ranges: Segments
    cameras: Segments
    chosen: Segments


def ring_lines(
    shots: viewpoints.Shots,
    location: int,
    chosen: int,
    vehicle_to_world: NDArray[np.float64],
    center: NDArray[np.float64],
) -> RingLines:
    """The lines of a ring around a vehicle placed as for :func:`viewpoints.viewpoint`; the ``chosen`` view is large."""
    ring, count = shots.ring, len(shots.ring)

    def at(view: int) -> viewpoints.Viewpoint:
        return viewpoints.viewpoint(shots, location, view, vehicle_to_world, center)

    def world(segments: list[NDArray[np.float64]]) -> Segments:
        turned = np.concatenate([NONE, *segments]) @ vehicle_to_world[:3, :3].T + vehicle_to_world[:3, 3]
        return turned.astype(np.float32)  # the graphics card's precision

    turns = np.linspace(0.0, 360.0, CIRCLE_STEPS + 1).tolist()
    rings = itertools.product(ring.elevations_deg, ring.distances_m)
    every = range(0, count, math.ceil(count / MOST_CAMERAS))
    cameras = [_frustum(at(view), CAMERA_SIZE) for view in every if view != chosen]
    picked = at(chosen)
    target = vehicle_to_world[:3, :3] @ center + vehicle_to_world[:3, 3]
    sight = np.stack([picked.camera.position, target])[None]
    straying = range(count) if count <= MOST_RANGES else (chosen,)
    return RingLines(
        circles=world([_joined([viewpoints.eye_at(turn, up, away, center) for turn in turns]) for up, away in rings]),
        ranges=world([edge for view in straying for edge in _range(ring, view, center)]),
        cameras=np.concatenate([NONE, *cameras]).astype(np.float32),
        chosen=np.concatenate([_frustum(picked, CHOSEN_SIZE), sight]).astype(np.float32),
    )


def _range(ring: contract.Ring, view: int, center: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Edges of a view's box in azimuth, elevation and distance; what does not vary has no edge."""
    nominal = ring.nominal(view)
    halves = (ring.jitter_azimuth_deg, ring.jitter_elevation_deg, ring.jitter_distance * nominal[2])
    spans = [(middle - half, middle + half) for middle, half in zip(nominal, halves, strict=True)]
    spans[1] = (min(spans[1][0], viewpoints.HIGHEST_DEG), min(spans[1][1], viewpoints.HIGHEST_DEG))
    edges = []
    for along in (axis for axis in range(3) if halves[axis]):
        for corner in itertools.product(*(sorted(set(span)) for axis, span in enumerate(spans) if axis != along)):
            places = [np.insert(corner, along, value) for value in np.linspace(*spans[along], EDGE_STEPS + 1)]
            edges.append(_joined([viewpoints.eye_at(place[0], place[1], place[2], center) for place in places]))
    return edges


def _frustum(view: viewpoints.Viewpoint, size: float) -> NDArray[np.float64]:
    """A camera's frustum and a roof that shows which way is up, (11, 2, 3)."""
    camera, depth = view.camera, size * view.distance_m
    half = depth * camera.width / 2 / camera.K[0, 0]
    corners = np.array([[-half, -half, depth], [half, -half, depth], [half, half, depth], [-half, half, depth]])
    roof = np.array([[-0.5 * half, -1.15 * half, depth], [0.0, -1.7 * half, depth], [0.5 * half, -1.15 * half, depth]])
    rays = [(np.zeros(3), corner) for corner in corners]
    outlines = [pair for outline in (corners, roof) for pair in zip(outline, np.roll(outline, -1, axis=0), strict=True)]
    return np.array([*rays, *outlines]) @ camera.R + camera.position  # rows times R: from the camera to the world


def _joined(points: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    path = np.array(points)
    return np.stack([path[:-1], path[1:]], axis=1)
