"""Rain between camera and scene, laid over a finished render.

Drops follow Marshall and Palmer (1948): per cubic metre and millimetre of diameter ``N0 exp(-slope D)`` of them, with
``N0`` = 8000 and ``slope = 4.1 R^-0.21`` /mm at a rain rate of R mm/h. They fall at their terminal speed (Atlas,
Srivastava and Sekhon 1973), drift with the wind and draw a streak while the shutter is open. Large drops near the
camera are drawn one by one; all others act as a haze of their total cross-section.

A drop covers what is behind it by alpha and shows the bright surroundings that it refracts, L. Over the light maps of a
frame that is ``A' = (1 - alpha) A``, ``B' = (1 - alpha) B + alpha L``: light stays affine in the paint.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .camera import Camera
from .seeding import named_rng, named_seed
from .weather import Weather

N0_PER_M3_MM = 8000.0
DRAWN_DIAMETER_MM, LARGEST_DIAMETER_MM = 1.5, 6.0
NEAREST_M, DRAWN_RANGE_M = 0.8, 8.0
SKY_RANGE_M = 1500.0  # rain before the sky: from here to the cloud
EXPOSURE_S = 1 / 100
WIND_MAX_M_S = 12.0
WIND_FROM_AXIS_DEG = 35.0  # the wind blows that way, counter-clockwise from world +x

# True drops cover so little for so short that at these image sizes rain is hardly seen. Drawn ones are thickened; 1 is
# physical. The haze is not thickened.
STREAK_GAIN = 10.0
EXTINCTION_EFFICIENCY = 2.0  # extinction over geometric cross-section of particles much larger than a wavelength

# Display-linear radiance of drops: (sun altitude, grey level). By day they show the sky, exposed to near white,
# at night what street lamps throw into them.
DROP_LIGHT = ((-18.0, 0.10), (-6.0, 0.12), (0.0, 0.3), (8.0, 0.55))
DROP_TINT_DAY, DROP_TINT_NIGHT = (0.97, 1.0, 1.03), (1.08, 0.98, 0.85)
# Samples along a streak, by its length in pixels: up to that length, so many.
SAMPLING = ((7.0, 6), (20.0, 18), (math.inf, 128))


@dataclass(frozen=True, eq=False)
class Streaks:
    """Rain as the camera sees it.

    Attributes:
        alpha: (H, W) float32 in [0, 1), how much of what is behind rain covers.
        radiance: (3,) float32, linear display-referred light of the rain itself.
    """

    alpha: NDArray[np.float32]
    radiance: NDArray[np.float32]


def seed_of(plan_seed: int, location: int, view: int, weather: Weather) -> int:
    """Names the drops of a frame, of a data set's ``plan_seed``: whoever takes rain out again draws the same ones."""
    return named_seed(plan_seed, "rain", location, view, weather.name)


def streaks(weather: Weather, camera: Camera, distance: NDArray[np.floating], seed: int) -> Streaks:
    """The rain of one frame.

    Args:
        distance: (H, W) metres along the view ray to the nearest surface, infinity for sky: rain behind is hidden.
        seed: names the drops; equal arguments give equal bits.
    """
    far = np.asarray(distance, np.float32)
    rate = weather.rain_rate_mm_h
    if rate == 0.0:
        return Streaks(np.zeros(far.shape, np.float32), np.zeros(3, np.float32))
    thickness = _drawn(weather, camera, far, named_rng(seed, "rain")) + _haze(rate, far)
    return Streaks((-np.expm1(-thickness)).astype(np.float32), drop_radiance(weather))


def over(image_linear: NDArray[np.floating], rain: Streaks) -> NDArray[np.float32]:
    """Rain before a finished image, (H, W, 3) linear; also what B becomes."""
    alpha = rain.alpha[..., None]
    return ((1.0 - alpha) * image_linear + alpha * rain.radiance).astype(np.float32)


def over_gain(A: NDArray[np.floating], rain: Streaks) -> NDArray[np.float32]:
    """What the gain A of the light maps becomes, (H, W, 3)."""
    return ((1.0 - rain.alpha[..., None]) * A).astype(np.float32)


def drop_radiance(weather: Weather) -> NDArray[np.float32]:
    """Display-linear light (3,) that drops send to the camera. It depends on the weather alone, not on the frame's
    pixels: every paint's frame gets the same rain.
    """
    altitudes, levels = zip(*DROP_LIGHT, strict=True)
    level = float(np.interp(weather.sun_altitude_angle, altitudes, levels))
    tint = np.array(DROP_TINT_DAY) * (1 - weather.lamps) + np.array(DROP_TINT_NIGHT) * weather.lamps
    return (level * tint).astype(np.float32)


def extinction(rain_rate_mm_h: float) -> float:
    """Extinction coefficient of rain, 1/m: its cross-section, ``pi/2 N0 / slope^3``, times the efficiency."""
    slope = _slope(rain_rate_mm_h)
    return EXTINCTION_EFFICIENCY * math.pi / 2 * N0_PER_M3_MM / slope**3 * 1e-6


def _slope(rate: float) -> float:
    return 4.1 * rate**-0.21


def _haze(rate: float, distance: NDArray[np.float32]) -> NDArray[np.float32]:
    """Optical thickness of the drops that are not drawn: the small ones everywhere, the large ones far away."""
    slope, least = _slope(rate), DRAWN_DIAMETER_MM
    # The part of the integral of D^2 exp(-slope D) beyond the smallest drawn drop.
    large = math.exp(-slope * least) * ((slope * least) ** 2 + 2 * slope * least + 2) / 2
    total = extinction(rate)
    reach = np.minimum(distance, SKY_RANGE_M)
    return total * (reach - large * np.minimum(reach, DRAWN_RANGE_M))


def _drawn(
    weather: Weather, camera: Camera, distance: NDArray[np.float32], rng: np.random.Generator
) -> NDArray[np.float32]:
    """Optical thickness of the drops drawn one by one, (H, W)."""
    height, width = distance.shape
    focal, slope = float(camera.K[0, 0]), _slope(weather.rain_rate_mm_h)
    # A frustum wider than the image: drops that only end inside it belong too.
    margin = 0.15 * max(width, height)
    area = (width + 2 * margin) * (height + 2 * margin) / focal**2
    volume = area * (DRAWN_RANGE_M**3 - NEAREST_M**3) / 3
    density = N0_PER_M3_MM / slope * (math.exp(-slope * DRAWN_DIAMETER_MM) - math.exp(-slope * LARGEST_DIAMETER_MM))
    count = int(rng.poisson(density * volume))
    u = rng.random((4, count), dtype=np.float32)
    depth = np.cbrt(NEAREST_M**3 + u[0] * (DRAWN_RANGE_M**3 - NEAREST_M**3))
    cut = 1 - math.exp(-slope * (LARGEST_DIAMETER_MM - DRAWN_DIAMETER_MM))
    diameter = DRAWN_DIAMETER_MM - np.log1p(-u[1] * np.float32(cut)) / np.float32(slope)
    start = np.stack(
        [
            (u[2] * (width + 2 * margin) - margin - camera.K[0, 2]) * depth / focal,
            (u[3] * (height + 2 * margin) - margin - camera.K[1, 2]) * depth / focal,
            depth,
        ]
    ).astype(np.float32)
    moved = _velocity(weather, diameter, camera) * np.float32(EXPOSURE_S)
    length = focal * np.hypot(moved[0], moved[1]) / depth
    total, shortest = np.zeros(distance.shape, np.float32), 0.0
    for longest, samples in SAMPLING:
        some = (length >= shortest) & (length < longest)
        across = rng.uniform(-0.5, 0.5, (samples, int(some.sum()))).astype(np.float32)
        total += _splat(start[:, some], moved[:, some], diameter[some] * np.float32(1e-3), across, camera, distance)
        shortest = longest
    return total


def _velocity(weather: Weather, diameter_mm: NDArray[np.float32], camera: Camera) -> NDArray[np.float32]:
    """(3, N) m/s in the camera's frame."""
    wind = weather.wind_intensity / 100 * WIND_MAX_M_S
    around = math.radians(WIND_FROM_AXIS_DEG)
    drift = camera.R @ np.array([wind * math.cos(around), wind * math.sin(around), 0.0])
    fall = 9.65 - 10.3 * np.exp(-0.6 * diameter_mm)
    return (drift[:, None] - camera.R[:, 2:] * fall).astype(np.float32)


def _splat(
    start: NDArray[np.float32],
    moved: NDArray[np.float32],
    diameter_m: NDArray[np.float32],
    across: NDArray[np.float32],
    camera: Camera,
    distance: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Spread each drop's cross-section along its way, bilinearly; samples behind a surface are left out.

    Args:
        start, moved: (3, N) metres in the camera's frame.
        across: (S, N) where each sample lies in the drop's width, -0.5 to 0.5.
    """
    height, width = distance.shape
    focal_x, focal_y, center_x, center_y = (np.float32(camera.K[i]) for i in ((0, 0), (1, 1), (0, 2), (1, 2)))
    steps = ((np.arange(len(across), dtype=np.float32) + 0.5) / len(across))[:, None]
    x, y, z = (start[i] + steps * moved[i] for i in range(3))
    x += across * diameter_m
    np.maximum(z, np.float32(0.5 * NEAREST_M), out=z)
    column, row = x / z * focal_x + center_x - np.float32(0.5), y / z * focal_y + center_y - np.float32(0.5)
    inside = (column > -1) & (column < width) & (row > -1) & (row < height)
    column, row, z = column[inside], row[inside], z[inside]
    ray = np.sqrt(x[inside] ** 2 + y[inside] ** 2 + z**2)
    nearest = distance[
        np.clip(np.rint(row).astype(np.int32), 0, height - 1), np.clip(np.rint(column).astype(np.int32), 0, width - 1)
    ]
    per_sample = np.float32(STREAK_GAIN * math.pi / 4 / len(across)) * diameter_m**2 * (focal_x * focal_y)
    thickness = np.broadcast_to(per_sample, inside.shape)[inside] / z**2
    return _bilinear(column, row, np.where(ray < nearest, thickness, np.float32(0)), height, width)


def _bilinear(
    column: NDArray[np.float32], row: NDArray[np.float32], amount: NDArray[np.float32], height: int, width: int
) -> NDArray[np.float32]:
    """Add amounts to the four pixels around each place; (height, width)."""
    left, top = np.floor(column), np.floor(row)
    right_share, low_share = column - left, row - top
    # One pixel of padding all around takes what falls beside the image.
    index = (top.astype(np.int64) + 1) * (width + 2) + left.astype(np.int64) + 1
    total = np.zeros((height + 2) * (width + 2))
    for step, share in (
        (0, (1 - right_share) * (1 - low_share)),
        (1, right_share * (1 - low_share)),
        (width + 2, (1 - right_share) * low_share),
        (width + 3, right_share * low_share),
    ):
        total += np.bincount(index + step, amount * share, minlength=total.size)
    return total.reshape(height + 2, width + 2)[1:-1, 1:-1].astype(np.float32)
