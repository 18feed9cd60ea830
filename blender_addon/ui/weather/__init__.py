"""Step 2: the weather in the viewport, and the weathers in which every view is rendered."""

from __future__ import annotations

from .panel import RAUCA_PT_weather, state
from .pictures import register, unregister
from .properties import RaucaShownWeather, RaucaWeather

CLASSES = (RaucaShownWeather, RaucaWeather, RAUCA_PT_weather)

__all__ = ["CLASSES", "RaucaWeather", "register", "state", "unregister"]
