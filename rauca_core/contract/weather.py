"""Weather in CARLA's terms, and its physical meaning here; preset files, which are named lists of weathers.

::

    {"format": "rauca-weathers", "version": 1, "convention": "carla", "weathers": [{"name": ..., ...}, ...]}

With ``"convention": "carla"`` the entries are CARLA's own parameters (`carla.WeatherParameters`); without it they are
ours. Names, ranges and defaults are CARLA 0.9.15's. Two things are converted or ignored, never silently:

- CARLA's world is left-handed, so its azimuth grows clockwise seen from above, ours counter-clockwise: ours is minus
  CARLA's. CARLA leaves the direction of azimuth zero open; it is taken as the world's +x here.
- Scattering parameters and dust storms have no counterpart. At CARLA's own defaults they change nothing; at another
  value the reader gets a note.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from .assets import assets_folder
from .errors import RaucaError
from .schema import MAX_NAME, Fields, Record, read_json

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
            is left-handed (:func:`weather_from_carla` converts).
        fog_density: 0 to 100; see :attr:`extinction`.
        cloudiness: 0 (clear) to 100 (overcast, no sun).
        precipitation: 0 to 100; rain of :attr:`rain_rate_mm_h`.
        precipitation_deposits: 0 to 100, how much of the ground puddles cover.
        wetness: 0 to 100, the film of water on everything; see :attr:`film`.
        wind_intensity: 0 to 100; slants the rain, see `rain.py`.
        fog_distance: metres around the camera that fog keeps clear of.
        fog_falloff: how fast fog thins out upwards, 0 (not at all) up: :attr:`extinction` times ``2^(-fog_falloff *
            height / 10 m)``, as CARLA's exponential height fog. The layer ends at :data:`FOG_TOP_M`, so that daylight
            reaches the street without more scattering events than a renderer follows.
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


_FORMAT = ("rauca-weathers", 1)
_CARLA_DEFAULTS = {"sun_altitude_angle": 0.0, "sun_azimuth_angle": 0.0, "fog_falloff": 0.2}  # others are ours
# Values at which a parameter without a counterpart says nothing: CARLA's two defaults (Python, and the C++ structure).
_WITHOUT_COUNTERPART = {
    "scattering_intensity": (1.0, 0.0),
    "mie_scattering_scale": (0.03, 0.0),
    "rayleigh_scattering_scale": (0.0331,),
    "dust_storm": (0.0,),
}


def weather_from_carla(
    parameters: dict[str, Any], name: str, where: str = "CARLA weather"
) -> tuple[Weather, list[str]]:
    """A CARLA weather in our terms.

    Args:
        parameters: any of the attributes of ``carla.WeatherParameters``; what is missing has CARLA's default.
        where: names the source in errors and notes.

    Returns:
        The weather and notes: a line for each parameter given that has no effect here.

    Raises:
        RaucaError: an unknown parameter, or a value outside CARLA's range.
    """
    ours = {parameter: value for parameter, value in parameters.items() if parameter not in _WITHOUT_COUNTERPART}
    weather = Weather.from_json(Fields(_CARLA_DEFAULTS | ours | {"name": name}, where))
    fields = Fields(parameters, where)
    notes = [
        f"{where}: {parameter} {fields.number(parameter):g} has no counterpart here and is ignored"
        for parameter, silent in _WITHOUT_COUNTERPART.items()
        if fields.has(parameter) and fields.number(parameter) not in silent
    ]
    return replace(weather, sun_azimuth_angle=-weather.sun_azimuth_angle % 360.0), notes


def find_preset(name_or_path: str) -> list[Weather]:
    """The weathers of a shipped preset, by name, or of a JSON file; an unknown name lists what there is."""
    return _read_preset(name_or_path)[0]


def preset_notes(name_or_path: str) -> list[str]:
    """What a preset asks for that has no effect here, a line each; for the caller to tell the user."""
    return _read_preset(name_or_path)[1]


def _read_preset(name_or_path: str) -> tuple[list[Weather], list[str]]:
    """Weathers, whose names are unique, and notes."""
    path = Path(name_or_path)
    if path.suffix != ".json":
        shipped = {found.stem: found for found in sorted((assets_folder() / "weathers").glob("*.json"))}
        if name_or_path not in shipped:
            raise RaucaError(
                f"weather preset {name_or_path!r} is unknown; choose one of {', '.join(shipped)} or a .json file"
            )
        path = shipped[name_or_path]
    fields = read_json(path)
    fields.format(*_FORMAT)
    carla = fields.has("convention") and fields.choice("convention", ("rauca", "carla")) == "carla"
    items = fields.objects("weathers")
    fields.done()
    if carla:
        read = [weather_from_carla(item.without("name"), item.text("name"), item.where) for item in items]
    else:
        read = [(Weather.from_json(item), []) for item in items]
    weathers = [weather for weather, _ in read]
    if not weathers or len({w.name for w in weathers}) != len(weathers):
        raise RaucaError(f"{path}: weathers must be a list of at least one, each with a name of its own")
    return weathers, [note for _, notes in read for note in notes]
