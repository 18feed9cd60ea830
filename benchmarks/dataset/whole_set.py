"""A whole set for real: every weather of a preset in nine colors, our way and one render at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from rauca_core.contract import Weather, find_preset, in_rendering_order
from rauca_core.contract.assets import assets_folder
from rauca_core.contract.color import TRAIN, recolor

from .results import WholeSet
from .settings import Settings
from .studio import Cost, Studio, timed


def whole_sets(
    studio: Studio, settings: Settings, naive_samples: Mapping[str, int], moved: Callable[[str], None]
) -> list[WholeSet]:
    """Render the settings' presets on their views."""
    rows = []
    for preset, views in settings.sets:
        weathers = find_preset(preset, assets_folder() / "weathers")
        for view in views:
            ours = _ours(studio, view, weathers)
            moved(f"{preset}, view {view}, ours")
            naive = _naive(studio, view, weathers, naive_samples)
            moved(f"{preset}, view {view}, naive")
            frames = len(weathers) * len(TRAIN)
            rows.append(WholeSet(preset, view, frames, ours.cpu, ours.wall, naive.cpu, dict(naive_samples)))
    return rows


def kind_of(weather: Weather) -> str:
    """Which kind's error stands for a weather's: clear, foggy or night (a foggy night counts as fog)."""
    return "foggy" if weather.extinction > 0 else "night" if weather.is_night else "clear"


def _ours(studio: Studio, view: int, weathers: list[Weather]) -> Cost:
    """As a data set's loop goes: lights together, fog growing."""
    studio.use(studio.default, tuple(weathers))
    with timed() as cost:
        for weather in in_rendering_order(weathers):
            A, B = studio.maps(view, weather)
            for color in TRAIN:
                recolor(A, B, color)
    return cost + studio.coverage


def _naive(studio: Studio, view: int, weathers: list[Weather], samples: Mapping[str, int]) -> Cost:
    """Weather by weather; the colors of one differ in nothing but the paint, so two of nine are rendered."""
    total = Cost()
    for weather in weathers:
        studio.use(replace(studio.default, samples=samples[kind_of(weather)], adaptive_threshold=0.0))
        with timed() as first:
            studio.render(view, weather, TRAIN[0])
        with timed() as second:
            studio.render(view, weather, TRAIN[-1])
        total = total + first + second.times(len(TRAIN) - 1)
    return total
