"""How true composed fog is, against how thick it is: by day and by night, and how a formula does instead."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from blender_addon.scene import composed_fog
from blender_addon.scene.light_maps import MARGIN_PX
from blender_addon.scene.render import Crop
from rauca_core.contract import Weather
from rauca_core.contract.color import recolor

from .error import Image, psnr_db, squared_errors
from .reference import References
from .results import FogPoint
from .settings import Settings
from .studio import LOCATION, Studio
from .sweep import COLORS

LIGHTS = {"day": Weather("day", 45.0), "night": Weather("night", -30.0)}


def fog_curve(
    studio: Studio, references: References, settings: Settings, moved: Callable[[str], None]
) -> list[FogPoint]:
    """Measure every density and light of the settings."""
    points = []
    for light, clear in LIGHTS.items():
        for density in settings.fog_densities:
            points.append(_measure(studio, references, settings, light, replace(clear, fog_density=density)))
            moved(f"fog {density:g}, {light}")
    return points


def _measure(studio: Studio, references: References, settings: Settings, light: str, weather: Weather) -> FogPoint:
    view = settings.views[0]
    halves, painted = references.of(view, weather, COLORS[0], settings.fog_samples), studio.painted(view)
    db = {
        f"{name}_db": psnr_db([squared_errors(frame, halves, painted).display])
        for name, frame in _frames(studio, view, weather).items()
    }
    return FogPoint(light, weather.fog_density, weather.extinction, **db)


def _frames(studio: Studio, view: int, weather: Weather) -> dict[str, Image]:
    """The grey vehicle by each method, at the default's quality."""
    clear, grey = replace(weather, name="under", fog_density=0.0), COLORS[0]
    studio.use(replace(studio.default, composed_fog=False))
    real = recolor(*studio.maps(view, weather), grey)
    studio.use(replace(studio.default, composed_fog=True), (clear, weather))
    unfogged = studio.render(view, clear, grey)
    studio.paint(grey)
    studio.set_weather(weather)
    coarse = studio.session.render_coarse(LOCATION, view, weather)
    distance = studio.sights[view].distance
    everywhere = composed_fog.compose(coarse, unfogged, distance, weather.extinction)
    crop = Crop.around(studio.sights[view].vehicle > 0, MARGIN_PX)
    composed = everywhere if crop is None else composed_fog.blend(everywhere, real[crop.inside], crop.inside)
    formula = by_formula(coarse, unfogged, np.asarray(distance, np.float32), weather.extinction)
    return {"real": real, "composed": composed, "everywhere": everywhere, "formula": formula}


def by_formula(coarse_linear: Image, clear_linear: Image, distance: Image, extinction: float) -> Image:
    """``k * T * clear + (1 - T) * airlight`` with the k and airlight per channel that fit the coarse picture best."""
    through = np.exp(-extinction * distance)[..., None].astype(np.float64)
    result = np.empty_like(clear_linear)
    for channel in range(3):
        guides = np.stack([through[..., 0] * clear_linear[..., channel], 1 - through[..., 0]], axis=-1)
        rows = composed_fog.coarsen(guides).reshape(-1, 2)
        scale = np.linalg.lstsq(rows, coarse_linear[..., channel].reshape(-1), rcond=None)[0]
        result[..., channel] = guides @ scale
    return result
