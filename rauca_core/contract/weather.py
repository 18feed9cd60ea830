"""Weather in CARLA's terms, and its physical meaning here."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from .errors import RaucaError
from .schema import MAX_NAME, Record

NIGHT_ALTITUDE_DEG = -18.0  # the end of astronomical twilight: a lower sun lights nothing
LAMPS_FULL_ALTITUDE_DEG = -6.0  # the end of civil twilight
FOG_TOP_M = 12.0

Percent = Annotated[float, (0, 100)]


@dataclass(frozen=True)
class Weather(Record):
    """One weather; the parameter names and ranges are CARLA's where they mean the same.

    Like CARLA's, the parameters are independent: rain without clouds is granted to whoever asks for it.

    Attributes:
        name: identifies the weather in folders and reports.
        sun_altitude_angle: degrees above the horizon, -90 to 90; the light fades from 0 to -18, where night begins.
        sun_azimuth_angle: degrees counter-clockwise from world +x, seen from above. CARLA's runs clockwise: its world
            is left-handed (`presets.py` converts).
        fog_density: 0 to 100; see :attr:`extinction`.
        cloudiness: 0 (clear) to 100 (overcast, no sun).
        precipitation: 0 to 100; rain of :attr:`rain_rate_mm_h`.
        precipitation_deposits: 0 to 100, how much of the ground puddles cover.
        wetness: 0 to 100, the film of water on everything; see :attr:`film`.
        wind_intensity: 0 to 100; slants the rain, see `rain.py`.
        fog_distance: metres around the camera that fog keeps clear of.
        fog_falloff: how fast fog thins out upwards, 0 (not at all) up; see :meth:`extinction_at`.
    """

    name: str
    sun_altitude_angle: Annotated[float, (-90, 90)]
    sun_azimuth_angle: Annotated[float, (-360, 360)] = 60.0
    fog_density: Percent = 0.0
    cloudiness: Percent = 0.0
    precipitation: Percent = 0.0
    precipitation_deposits: Percent = 0.0
    wetness: Percent = 0.0
    wind_intensity: Percent = 0.0
    fog_distance: Annotated[float, (0, 1e6)] = 0.0
    fog_falloff: Annotated[float, (0, 1e3)] = 0.0

    @property
    def extinction(self) -> float:
        """Fog extinction coefficient on the ground, 1/m: 0.06 * (fog_density / 100)^2.

        Koschmieder's visibility, 3.912 / extinction, is 1040 m at density 25, 260 m at 50, 80 m at 90.
        """
        return 0.06 * (self.fog_density / 100.0) ** 2

    def extinction_at(self, height_m: NDArray[np.floating[Any]] | float) -> NDArray[np.float64]:
        """Fog extinction coefficient at a height, 1/m: ``extinction * 2^(-fog_falloff * height / 10 m)``.

        The exponential height fog behind CARLA's parameter: falloff 1 halves the fog every 10 m, 5 every 2 m. The layer
        ends at :data:`FOG_TOP_M`, so that daylight reaches the street without more scattering events than a renderer
        follows.
        """
        height = np.asarray(height_m, float)
        inside = (height >= 0) & (height <= FOG_TOP_M)
        return np.where(inside, self.extinction * np.exp2(-self.fog_falloff * np.maximum(height, 0) / 10.0), 0.0)

    @property
    def fog_is_uniform(self) -> bool:
        """True when the fog layer is the same everywhere in it (or there is none)."""
        return self.extinction == 0.0 or (self.fog_falloff == 0.0 and self.fog_distance == 0.0)

    @property
    def is_night(self) -> bool:
        """The sun is below the horizon; lamps are lit, as bright as :attr:`lamps` says."""
        return self.sun_altitude_angle < 0.0

    @property
    def lamps(self) -> float:
        """How far street and vehicle lamps are turned up: 0 by day to 1 from the end of civil twilight on, smoothly."""
        t = float(np.clip(self.sun_altitude_angle / LAMPS_FULL_ALTITUDE_DEG, 0.0, 1.0))
        return t * t * (3.0 - 2.0 * t)

    @property
    def film(self) -> float:
        """Water on surfaces, 0 to 1: the wetness, or what rain and puddles imply: neither leaves a surface dry."""
        return max(self.wetness, 0.6 * self.precipitation_deposits, min(90.0, 6.0 * self.precipitation)) / 100.0

    @property
    def puddles(self) -> float:
        """Puddles on flat ground, 0 to 1."""
        return self.precipitation_deposits / 100.0

    @property
    def ripples(self) -> float:
        """How far rain breaks the mirror of puddles, 0 to 1: by drops that fall on each square metre."""
        return min(1.0, self.precipitation / 50.0)

    @property
    def rain_rate_mm_h(self) -> float:
        """Millimetres per hour: 50 * (precipitation / 100)^2, so 30 is moderate, 60 heavy, 100 violent rain."""
        return 50.0 * (self.precipitation / 100.0) ** 2

    def light_key(self) -> tuple[float, ...]:
        """What a render depends on: weathers with equal keys are one render (rain streaks come after it).

        That is its sky, the fog's shape if there is fog, and precipitation by the water it leaves.
        """
        fog = (self.extinction, self.fog_falloff, self.fog_distance) if self.extinction > 0 else (0.0, 0.0, 0.0)
        ripples = self.ripples if self.puddles > 0 else 0.0
        return (*self.sky_key(), *fog, self.film, self.puddles, ripples)

    def sky_key(self) -> tuple[float, float, float]:
        """What the sky depends on: weathers with equal keys have one sky.

        The sun counts as long as it is above -18 degrees, its azimuth unless it stands in the zenith.
        """
        dark, zenith = self.sun_altitude_angle <= NIGHT_ALTITUDE_DEG, self.sun_altitude_angle == 90.0
        sun = max(self.sun_altitude_angle, NIGHT_ALTITUDE_DEG)
        azimuth = 0.0 if dark or zenith else self.sun_azimuth_angle % 360.0
        return (sun, azimuth, self.cloudiness)

    def _check_whole(self, where: str) -> None:
        """The name has to name a folder."""
        if len(self.name) > MAX_NAME:
            raise RaucaError(
                f"{where}: name {self.name[:20]}... has {len(self.name)} characters, at most {MAX_NAME} are taken"
            )
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", self.name):
            raise RaucaError(f"{where}: name {self.name!r} may hold only letters, digits, '_', '.' and '-'")
