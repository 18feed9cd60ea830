"""Where the cameras stand: the paper's ring, a ring so close that the car fills the frame, and random cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rauca_core.contract import Camera, Vehicle

GOLDEN = (5**0.5 - 1) / 2  # steps of a golden share never line up with a car's symmetry


@dataclass(frozen=True)
class Orbit:
    """Ranges of a ring: metres and degrees."""

    fov_deg: float
    distances_m: tuple[float, float]
    elevations_deg: tuple[float, float] = (5.0, 50.0)


ORBITS = {"paper": Orbit(90.0, (5.0, 15.0)), "close": Orbit(60.0, (4.2, 4.8))}
RINGS = tuple(ORBITS)


def ring(vehicle: Vehicle, name: str, number: int, size: int) -> list[Camera]:
    """``number`` cameras around the vehicle, square, ``size`` pixels.

    The ``paper`` ring has the paper's lens (90 degrees) and distances (5 to 15 m); ``close`` fills the frame. Azimuths
    go around once; elevations and distances run through their ranges in golden steps, so a few views cover them all.
    """
    orbit = ORBITS[name]
    (near, far), (low, high) = orbit.distances_m, orbit.elevations_deg
    cameras = []
    for i in range(number):
        share = (i * GOLDEN + 0.5) % 1
        distance = 1 / (share / near + (1 - share) / far)  # even steps in apparent size
        elevation = low + (high - low) * ((i * GOLDEN**2 + 0.25) % 1)
        cameras.append(_orbit(vehicle, 360.0 * (i + 0.37) / number, elevation, distance, orbit.fov_deg, size))
    return cameras


def random_cameras(vehicle: Vehicle, number: int, size: int, seed: int = 0) -> list[Camera]:
    """Cameras that all see the car: any azimuth, 0 to 70 degrees up, 4 to 15 m, 40 to 90 degrees wide, rolled."""
    rng = np.random.default_rng(seed)
    cameras = []
    for _ in range(number):
        azimuth, elevation = rng.uniform(0, 360), rng.uniform(0, 70)
        distance, fov = rng.uniform(4, 15), rng.uniform(40, 90)
        aim, roll = rng.uniform(-0.5, 0.5, 3), rng.uniform(-15, 15)
        cameras.append(_orbit(vehicle, azimuth, elevation, distance, fov, size, aim, roll))
    return cameras


def _orbit(
    vehicle: Vehicle,
    azimuth: float,
    elevation: float,
    distance: float,
    fov: float,
    size: int,
    shift: np.ndarray | float = 0.0,
    roll: float = 0.0,
) -> Camera:
    """A camera at angles in degrees around the middle of the vehicle, looking at it ``shift`` metres off."""
    middle = (vehicle.positions.max(0) + vehicle.positions.min(0)).astype(np.float64) / 2
    a, e = np.radians([azimuth, elevation])
    eye = middle + distance * np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    return Camera.look_at(eye, middle + shift, fov, size, size, roll)
