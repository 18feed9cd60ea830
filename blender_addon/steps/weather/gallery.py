"""The lists of weathers a user chooses from, and their pictures."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

from ...core import assets, contract
from ...jobs import pictures

# Identifier, name and tooltip of every shipped list, in the order of the menu.
SHIPPED = (
    ("demo", "First Steps", "Three weathers for a first try: clear day, low sun, light fog"),
    ("single", "Clear Day", "One clear day, nothing else"),
    ("base", "Base", "Four heights of the sun, night among them, by four densities of fog"),
    ("enhanced", "Enhanced", "Four heights of the sun by four densities of fog, with the harder low sun"),
    ("unseen", "Unseen", "Sixteen weathers that the other lists do not have: rain, wet roads, clouds, dusk, mist"),
    ("carla", "CARLA", "The 21 weathers of the CARLA simulator, from ClearNoon to HardRainNight"),
)
OWN = "OWN"


@cache
def shipped(name: str) -> tuple[contract.Weather, ...]:
    """The weathers of a shipped list."""
    return tuple(contract.find_preset(name))


def own(path: str) -> tuple[contract.Weather, ...]:
    """The weathers of a user's file, read again only when it has changed.

    Raises:
        RaucaError: no file is chosen, or it cannot be read.
    """
    if not path:
        raise contract.RaucaError("No list of weathers: choose a .json file in step 2, Weather")
    try:
        changed = Path(path).stat().st_mtime_ns
    except OSError:
        raise contract.RaucaError(f"{path}: no such file; choose a list of weathers in step 2, Weather") from None
    return _own(path, changed)


@cache
def _own(path: str, changed: int) -> tuple[contract.Weather, ...]:
    return tuple(contract.find_preset(path))


Item = tuple[str, str, str, int | str, int]


def unregister() -> None:
    gallery_items.cache_clear()  # the pictures go with the jobs'


@cache  # Blender keeps no copy of an enumeration's strings: they must stay alive, and the same
def gallery_items(weathers: Sequence[contract.Weather]) -> list[Item]:
    """Items of the gallery; a weather without a picture shows as Blender's world icon."""
    return [
        (weather.name, display_name(weather.name), describe(weather), _icon(weather.name), number)
        for number, weather in enumerate(weathers)
    ]


def display_name(name: str) -> str:
    """A weather's name for people: ``night-mist`` becomes ``night mist``; a minus before a number stays."""
    return name.replace("sun-", "sun \N{MINUS SIGN}").replace("-", " ").replace("_", " ")


def describe(weather: contract.Weather) -> str:
    """A tooltip: what is not at rest in a weather."""
    values = {
        "fog": weather.fog_density,
        "clouds": weather.cloudiness,
        "rain": weather.precipitation,
        "wet": weather.wetness,
        "puddles": weather.precipitation_deposits,
    }
    at_work = [f"{label} {value:g}" for label, value in values.items() if value]
    return ", ".join([f"sun {weather.sun_altitude_angle:g}°", *at_work])


def _icon(name: str) -> int | str:
    path = assets.assets_folder() / "weathers" / "pictures" / f"{name}.jpg"
    return pictures.load(f"weather.{name}", path) if path.is_file() else "WORLD"
