"""Step 2: the weather in the viewport, and the weathers in which every view is rendered."""

from __future__ import annotations

from . import pictures, rain
from .panel import RAUCA_PT_weather, state
from .properties import RaucaShownWeather, RaucaWeather

CLASSES = (RaucaShownWeather, RaucaWeather, RAUCA_PT_weather)


def register() -> None:
    pictures.register()
    rain.register()


def unregister() -> None:
    rain.unregister()
    pictures.unregister()


__all__ = ["CLASSES", "RaucaWeather", "register", "state", "unregister"]
