"""The lists of weathers a user chooses from: the shipped ones, and a file of his own."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from ...core import assets, contract

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
    return tuple(contract.find_preset(name, assets.assets_folder() / "weathers"))


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
    return tuple(contract.load_weathers(Path(path)))
