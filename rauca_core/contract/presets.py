"""Preset files: named lists of weathers.

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

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from .errors import RaucaError
from .files import write_json
from .schema import Fields, read_json
from .weather import Weather

PRESET_FORMAT = ("rauca-weathers", 1)
CARLA_DEFAULTS = {"sun_altitude_angle": 0.0, "sun_azimuth_angle": 0.0, "fog_falloff": 0.2}  # others are ours
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
    ours = {parameter: value for parameter, value in parameters.items() if parameter not in WITHOUT_COUNTERPART}
    weather = Weather.from_json(Fields(CARLA_DEFAULTS | ours | {"name": name}, where))
    fields = Fields(parameters, where)
    notes = [
        f"{where}: {parameter} {fields.number(parameter):g} has no counterpart here and is ignored"
        for parameter, silent in WITHOUT_COUNTERPART.items()
        if fields.has(parameter) and fields.number(parameter) not in silent
    ]
    return replace(weather, sun_azimuth_angle=-weather.sun_azimuth_angle % 360.0), notes


def load_weathers(path: Path) -> list[Weather]:
    """Read a preset file. Names must be unique and the list not empty."""
    return _read(Path(path))[0]


def save_weathers(path: Path, weathers: Sequence[Weather]) -> None:
    """Write a preset file in place of the one that may be there."""
    name, version = PRESET_FORMAT
    write_json(path, {"format": name, "version": version, "weathers": [weather.to_json() for weather in weathers]})


def find_preset(name_or_path: str, folder: Path) -> list[Weather]:
    """A preset by name from ``folder``, or by path to a JSON file; an unknown name lists what there is."""
    return _read(_path(name_or_path, folder))[0]


def preset_notes(name_or_path: str, folder: Path) -> list[str]:
    """What a preset asks for that has no effect here, a line each; for the caller to tell the user."""
    return _read(_path(name_or_path, folder))[1]


def _path(name_or_path: str, folder: Path) -> Path:
    if name_or_path.endswith(".json"):
        return Path(name_or_path)
    known = sorted(p.stem for p in folder.glob("*.json"))
    if name_or_path not in known:
        raise RaucaError(
            f"weather preset {name_or_path!r} is unknown; choose one of {', '.join(known)} or a .json file"
        )
    return folder / f"{name_or_path}.json"


def _read(path: Path) -> tuple[list[Weather], list[str]]:
    fields = read_json(path)
    fields.format(*PRESET_FORMAT)
    convention = fields.choice("convention", ("rauca", "carla")) if fields.has("convention") else "rauca"
    items = fields.objects("weathers")
    fields.done()
    weathers, notes = [], []
    for item in items:
        if convention == "rauca":
            weathers.append(Weather.from_json(item))
        else:
            weather, ignored = weather_from_carla(item.without("name"), item.text("name"), item.where)
            weathers.append(weather)
            notes += ignored
    if not weathers or len({w.name for w in weathers}) != len(weathers):
        raise RaucaError(f"{path}: weathers must be a list of at least one, each with a name of its own")
    return weathers, notes
