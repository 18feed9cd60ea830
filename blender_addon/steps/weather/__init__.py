"""Step 2: the weather in the viewport, and the weathers in which every view is rendered."""

from __future__ import annotations

from . import gallery, operators, rain_overlay
from .panel import RAUCA_PT_weather, state
from .properties import RaucaShownWeather, RaucaWeather

CLASSES = (RaucaShownWeather, RaucaWeather, *operators.CLASSES, RAUCA_PT_weather)


def register() -> None:
    gallery.register()
    rain_overlay.register()


def unregister() -> None:
    rain_overlay.unregister()
    gallery.unregister()


__all__ = ["CLASSES", "RaucaWeather", "register", "state", "unregister"]
