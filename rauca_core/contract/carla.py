"""Weathers brought over from CARLA (`carla.WeatherParameters`).

Names, ranges and defaults are CARLA 0.9.15's. Two things are converted or ignored, never silently:

- CARLA's world is left-handed, so its azimuth grows clockwise seen from above, ours counter-clockwise: ours is minus
  CARLA's. CARLA leaves the direction of azimuth zero open; it is taken as the world's +x here.
- Scattering parameters and dust storms have no counterpart. At CARLA's own defaults they change nothing; at another
  value the reader gets a note.
"""

from __future__ import annotations

from typing import Any

from .schema import Fields
from .weather import LIMITS, Weather

DEFAULTS = {
    "cloudiness": 0.0,
    "precipitation": 0.0,
    "precipitation_deposits": 0.0,
    "wind_intensity": 0.0,
    "sun_azimuth_angle": 0.0,
    "sun_altitude_angle": 0.0,
    "fog_density": 0.0,
    "fog_distance": 0.0,
    "fog_falloff": 0.2,
    "wetness": 0.0,
}
# Values at which a parameter without a counterpart says nothing: CARLA's two defaults (Python, and the C++ structure).
WITHOUT_COUNTERPART = {
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
    fields, notes = Fields(parameters, where), []
    numbers = {}
    for parameter, default in DEFAULTS.items():
        low, high, _ = LIMITS[parameter]
        numbers[parameter] = fields.number(parameter, low, high) if fields.has(parameter) else default
    for parameter, silent in WITHOUT_COUNTERPART.items():
        if fields.has(parameter) and fields.number(parameter) not in silent:
            notes.append(f"{where}: {parameter} {fields.number(parameter):g} has no counterpart here and is ignored")
    fields.done()
    numbers["sun_azimuth_angle"] = -numbers["sun_azimuth_angle"] % 360.0
    return Weather(name, **numbers).checked(where), notes
