"""Weather in CARLA's terms, and its physical meaning here."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from .errors import RaucaError
from .schema import Fields, read_json

PRESET_FORMAT = ("rauca-weathers", 1)


@dataclass(frozen=True)
class Weather:
    """One weather; the parameter names and ranges are CARLA's where they mean the same.

    Attributes:
        name: identifies the weather in folders and reports.
        sun_altitude_angle: degrees above the horizon, -90 to 90; below zero it is night.
        sun_azimuth_angle: degrees counter-clockwise from world +x, seen from above.
        fog_density: CARLA's 0 to 100; see :attr:`extinction`.
    """

    name: str
    sun_altitude_angle: float
    sun_azimuth_angle: float = 60.0
    fog_density: float = 0.0

    @property
    def extinction(self) -> float:
        """Fog extinction coefficient, 1/m: 0.06 * (fog_density / 100)^2.

        Koschmieder's visibility, 3.912 / extinction, is 1040 m at density 25, 260 m at 50, 80 m at 90.
        """
        return 0.06 * (self.fog_density / 100.0) ** 2

    @property
    def is_night(self) -> bool:
        return self.sun_altitude_angle < 0.0

    def to_json(self) -> dict[str, Any]:
        return asdict(self)

    @staticmethod
    def from_json(fields: Fields) -> Weather:
        weather = Weather(
            name=fields.text("name"),
            sun_altitude_angle=fields.number("sun_altitude_angle", -90, 90),
            sun_azimuth_angle=fields.number("sun_azimuth_angle", -360, 360),
            fog_density=fields.number("fog_density", 0, 100),
        )
        fields.done()
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", weather.name):
            raise RaucaError(f"{fields.where}: name {weather.name!r} may hold only letters, digits, '_', '.' and '-'")
        return weather


def load_weathers(path: Path) -> list[Weather]:
    """Read a preset file: a named list of weathers. Names must be unique and the list not empty."""
    fields = read_json(path)
    fields.format(*PRESET_FORMAT)
    weathers = [
        Weather.from_json(Fields(item, f"{path}: weathers[{i}]")) for i, item in enumerate(fields.items("weathers"))
    ]
    fields.done()
    if not weathers or len({w.name for w in weathers}) != len(weathers):
        raise RaucaError(f"{path}: weathers must be a list of at least one, each with a name of its own")
    return weathers


def find_preset(name_or_path: str, folder: Path) -> list[Weather]:
    """A preset by name from ``folder``, or by path to a JSON file; an unknown name lists what there is."""
    if name_or_path.endswith(".json"):
        return load_weathers(Path(name_or_path))
    known = sorted(p.stem for p in folder.glob("*.json"))
    if name_or_path not in known:
        raise RaucaError(
            f"weather preset {name_or_path!r} is unknown; choose one of {', '.join(known)} or a .json file"
        )
    return load_weathers(folder / f"{name_or_path}.json")
