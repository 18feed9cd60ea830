"""Where the camera of a view stands, jitter included: a function of the plan."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .camera import Camera
from .clips import Clips, Street, driving_camera, moves
from .plan import Plan, Ring
from .seeding import named_rng

GROUND_CLEARANCE_M = 0.3
HIGHEST_DEG = 89.0  # straight down there is no telling which way is up


@dataclass(frozen=True)
class Shots:
    """What of a plan places the cameras, before there is a plan."""

    ring: Ring
    size: int
    seed: int


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """A camera in world space and the polar coordinates it came from (degrees and metres, after jitter)."""

    camera: Camera
    azimuth_deg: float
    elevation_deg: float
    distance_m: float


def viewpoint(
    plan: Plan | Shots,
    location: int,
    view: int,
    vehicle_to_world: NDArray[np.float64],
    center: NDArray[np.float64],
) -> Viewpoint:
    """The camera of one view.

    Jitter depends on the plan's seed, the location and the view, not on the weather: weathers share cameras, so they
    share coverage renders and renderer taps.

    Args:
        vehicle_to_world: (4, 4) rigid transform.
        center: (3,) the point looked at, in the vehicle's frame, metres.
    """
    ring = plan.ring
    rng = named_rng(plan.seed, "ring", location, view)
    azimuth, elevation, distance = ring.nominal(view)
    azimuth += rng.uniform(-1, 1) * ring.jitter_azimuth_deg
    elevation = min(elevation + rng.uniform(-1, 1) * ring.jitter_elevation_deg, HIGHEST_DEG)
    distance *= 1 + rng.uniform(-1, 1) * ring.jitter_distance
    aim = center + rng.uniform(-1, 1, 3) * ring.jitter_aim_m
    roll = rng.uniform(-1, 1) * ring.jitter_roll_deg

    eye = eye_at(azimuth, elevation, distance, center)
    world = np.stack([eye, aim]) @ vehicle_to_world[:3, :3].T + vehicle_to_world[:3, 3]
    camera = Camera.look_at(world[0], world[1], ring.fov_deg, plan.size, plan.size, roll)
    return Viewpoint(camera, azimuth % 360.0, elevation, distance)


def driven(
    plan: Plan, clips: Clips, view: int, street: Street, center: NDArray[np.float64], later_s: float = 0.0
) -> tuple[Viewpoint, NDArray[np.float64]]:
    """The camera of a clip's view, and (4, 4) the vehicle to world; other arguments as of :func:`viewpoint`.

    Args:
        later_s: after the view's time.
    """
    spot, place = moves(clips, view, later_s)
    camera, pose = driving_camera(street, spot, plan.ring.fov_deg, plan.size), street.at(place)
    x, y, z = camera.relative_to(pose).position - center
    flat = math.hypot(x, y)
    azimuth, elevation = math.degrees(math.atan2(y, x)) % 360.0, math.degrees(math.atan2(z, flat))
    return Viewpoint(camera, azimuth, elevation, math.hypot(flat, z)), pose


def eye_at(
    azimuth_deg: float, elevation_deg: float, distance_m: float, center: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Where a camera of these polar coordinates stands, (3,) in the vehicle's frame; never in the ground."""
    flat = distance_m * math.cos(math.radians(elevation_deg))
    azimuth, up = math.radians(azimuth_deg), distance_m * math.sin(math.radians(elevation_deg))
    eye: NDArray[np.float64] = center + np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), up])
    eye[2] = max(eye[2], GROUND_CLEARANCE_M)
    return eye
