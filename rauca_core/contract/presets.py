"""Preset files: named lists of weathers.

::

    {"format": "rauca-weathers", "version": 1, "convention": "carla", "weathers": [{"name": ..., ...}, ...]}

With ``"convention": "carla"`` the entries are CARLA's own parameters (`carla.py`); without it they are ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .carla import weather_from_carla
from .errors import RaucaError
from .files import write_json
from .schema import Fields, read_json
from .weather import Weather

PRESET_FORMAT = ("rauca-weathers", 1)


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
    convention = fields.text("convention") if fields.has("convention") else "rauca"
    if convention not in ("rauca", "carla"):
        raise RaucaError(f"{path}: convention must be rauca or carla, not {convention!r}")
    items = [Fields(item, f"{path}: weathers[{i}]") for i, item in enumerate(fields.items("weathers"))]
    fields.done()
    weathers, notes = [], []
    for item in items:
        if convention == "carla":
            weather, ignored = weather_from_carla(item.without("name"), item.text("name"), item.where)
            notes += ignored
        else:
            weather = Weather.from_json(item)
        weathers.append(weather)
    if not weathers or len({w.name for w in weathers}) != len(weathers):
        raise RaucaError(f"{path}: weathers must be a list of at least one, each with a name of its own")
    return weathers, notes
