"""Falling rain drawn over the viewport while a rainy weather is shown."""

from __future__ import annotations

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ...core import contract
from ...scene.shown_weather import rain_picture
from ..panel import ViewportOverlay

WIDTH_STEP_PX = 64  # a viewport that is dragged wider gets a new picture only so often


def _draw(context: bpy.types.Context) -> None:
    settings, region = context.scene.rauca.weather, context.region
    if not settings.shown.on or settings.rain == 0.0 or context.space_data.shading.type not in {"MATERIAL", "RENDERED"}:
        return
    weather = settings.current()
    aspect = -(-region.width // WIDTH_STEP_PX) * WIDTH_STEP_PX / max(region.height, 1)
    key = (weather.precipitation, weather.wind_intensity, weather.sun_altitude_angle, round(aspect, 2))
    texture = _rain.kept(key, lambda: _texture(weather, aspect))
    right, top = float(region.width), float(region.height)
    corners = ((0.0, 0.0), (right, 0.0), (0.0, top), (right, top))
    shader = gpu.shader.from_builtin("IMAGE")
    # Row 0 of the picture is at the top, of a texture at the bottom.
    batch = batch_for_shader(shader, "TRI_STRIP", {"pos": corners, "texCoord": ((0, 1), (1, 1), (0, 0), (1, 0))})
    gpu.state.blend_set("ALPHA")
    shader.bind()
    shader.uniform_sampler("image", texture)
    batch.draw(shader)
    gpu.state.blend_set("NONE")


def _texture(weather: contract.Weather, aspect: float) -> gpu.types.GPUTexture:
    picture = rain_picture(weather, aspect)
    assert picture is not None  # it rains
    height, width, _ = picture.shape
    pixels = gpu.types.Buffer("FLOAT", picture.size, np.ascontiguousarray(picture).ravel())
    return gpu.types.GPUTexture((width, height), format="RGBA16F", data=pixels)


_rain = ViewportOverlay(_draw, "POST_PIXEL")
register, unregister = _rain.register, _rain.unregister
