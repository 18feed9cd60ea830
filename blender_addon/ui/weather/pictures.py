"""Small pictures of the shipped weathers, for the gallery."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import bpy
import bpy.utils.previews

from ...core import assets, contract

_previews: dict[str, bpy.utils.previews.ImagePreviewCollection] = {}
Item = tuple[str, str, str, int | str, int]


def register() -> None:
    _previews["weathers"] = bpy.utils.previews.new()


def unregister() -> None:
    bpy.utils.previews.remove(_previews.pop("weathers"))
    gallery.cache_clear()


@cache  # Blender keeps no copy of an enumeration's strings: they must stay alive, and the same
def gallery(weathers: Sequence[contract.Weather]) -> list[Item]:
    """Items of the gallery; a weather without a picture shows as Blender's world icon."""
    return [
        (weather.name, spoken(weather.name), describe(weather), _icon(weather.name), number)
        for number, weather in enumerate(weathers)
    ]


def spoken(name: str) -> str:
    """A weather's name for people: ``night-mist`` becomes ``night mist``; a minus before a number stays."""
    return name.replace("sun-", "sun \N{MINUS SIGN}").replace("-", " ").replace("_", " ")


def describe(weather: contract.Weather) -> str:
    """A tooltip: what is not at rest in a weather."""
    said = [f"sun {weather.sun_altitude_angle:g}°"]
    for label, value in (
        *(("fog", weather.fog_density), ("clouds", weather.cloudiness), ("rain", weather.precipitation)),
        *(("wet", weather.wetness), ("puddles", weather.precipitation_deposits)),
    ):
        if value:
            said.append(f"{label} {value:g}")
    return ", ".join(said)


def _icon(name: str) -> int | str:
    path = assets.assets_folder() / "weathers" / "pictures" / f"{name}.jpg"
    pictures = _previews.get("weathers")
    if pictures is None or not path.is_file():
        return "WORLD"
    if name not in pictures:
        pictures.load(name, str(path), "IMAGE")
    return int(pictures[name].icon_id)
