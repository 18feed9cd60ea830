"""Cost and error of renders and light maps over the renderer's settings, for clear, foggy and night."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace

from rauca_core.contract import Quality, Weather
from rauca_core.contract.color import Color, recolor

from .error import Image, SquaredErrors, psnr_db, squared_errors
from .reference import References
from .results import MAPS, SINGLE, Entry
from .settings import KINDS, Settings
from .studio import Cost, Studio, timed

WEATHERS = {
    "clear": Weather("clear", 45.0),
    "foggy": Weather("foggy", 45.0, fog_density=50.0),
    "night": Weather("night", -30.0),
}
assert tuple(WEATHERS) == KINDS
COLORS: tuple[Color, ...] = ((128, 128, 128), (255, 0, 0))  # of the recoloring set: its middle, and a hard one


def variants(settings: Settings, default: Quality) -> Iterator[tuple[str, str, Quality]]:
    """(what, axis, quality) of everything that is measured; the default light maps come first."""
    yield MAPS, "samples", default
    plain = replace(default, adaptive_threshold=0.0, denoise=True)
    raw = replace(plain, denoise=False)
    for samples in settings.map_samples:
        if replace(plain, samples=samples) != default:
            yield MAPS, "samples", replace(plain, samples=samples)
    for samples in settings.single_samples:
        yield SINGLE, "samples", replace(plain, samples=samples)
    for samples in settings.raw_samples:
        yield SINGLE, "raw", replace(raw, samples=samples)
        yield MAPS, "raw", replace(raw, samples=samples)
    for threshold in settings.thresholds:
        yield MAPS, "adaptive", replace(plain, samples=settings.adaptive_samples, adaptive_threshold=threshold)
    for bounces in settings.bounces:
        yield MAPS, "bounces", replace(default, bounces=bounces)
    yield MAPS, "fog", replace(default, composed_fog=not default.composed_fog)


def measure(
    studio: Studio, references: References, settings: Settings, kind: str, what: str, axis: str, quality: Quality
) -> Entry:
    """Measure one variant over the settings' views and both colors."""
    weather, errors, cost = WEATHERS[kind], list[SquaredErrors](), Cost()
    for view in settings.views:
        halves = [references.of(view, weather, color, settings.reference_samples) for color in COLORS]
        if what == MAPS:
            spent, frames = _through_maps(studio, view, weather, quality)
        else:
            spent, frames = _one_by_one(studio, view, weather, quality)
        cost += spent.times(1 / len(settings.views))
        errors += [squared_errors(f, h, studio.painted(view)) for f, h in zip(frames, halves, strict=True)]
    display, linear, paint = (psnr_db(list(column)) for column in zip(*errors, strict=True))
    return Entry(what, axis, kind, **asdict(quality), psnr_db=display, linear_psnr_db=linear, paint_psnr_db=paint,
                 cpu_seconds=cost.cpu, wall_seconds=cost.wall)  # fmt: skip


def _through_maps(studio: Studio, view: int, weather: Weather, quality: Quality) -> tuple[Cost, list[Image]]:
    """Light maps as a data set makes them: where fog is composed, the clear view is there already."""
    clear = replace(weather, name="under", fog_density=0.0)
    studio.use(quality, (clear, weather))
    if quality.composed_fog and weather.extinction > 0:
        studio.maps(view, clear)
    studio.settle(view, weather)
    with timed() as cost:
        A, B = studio.maps(view, weather)
    return cost, [recolor(A, B, color) for color in COLORS]


def _one_by_one(studio: Studio, view: int, weather: Weather, quality: Quality) -> tuple[Cost, list[Image]]:
    studio.use(quality)
    studio.settle(view, weather)
    with timed() as cost:
        frames = [studio.render(view, weather, color) for color in COLORS]
    return cost.times(1 / len(COLORS)), frames
