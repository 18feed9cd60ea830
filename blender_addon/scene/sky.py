"""The sky of a contract weather: sun, clouds, the glow of the night, and the exposure that suits it.

Clouds are a layer drawn by noise. Light on the ground follows Kasten and Czeplak (1980): a share of 1 - 0.75 c^3.4 of
the clear sky's under a cloud cover c. The sun is dimmed and widened by the cover as a whole, wherever the drawn clouds
stand: a frame's shadows must not depend on whether one of them happens to cross the sun.
"""

from __future__ import annotations

import math

import bpy
import numpy as np

from .. import compat
from ..core import contract
from . import nodes

# Linear radiance of the night sky before exposure, clear and overcast: dark, not black, as CARLA's night; clouds throw
# the street lamps' light back.
NIGHT_SKY, NIGHT_CLOUDS = (0.012, 0.016, 0.028), (0.018, 0.0155, 0.0145)

# Film exposure per sun altitude (degrees) in powers of two: brings an 18 % grey card lying flat under this sky, without
# fog, to 0.2-0.3 of display white by day and 0.13 at sunset. It hardly moves after sunset, when lamps light the street.
# `tests/blender/test_weather_light.py` measures it again.
EXPOSURE_STOPS = (
    *((-18.0, math.log2(4.0)), (0.0, 1.0), (2.0, 0.3), (5.0, -1.0), (10.0, -2.2), (20.0, -3.35)),
    *((30.0, -3.95), (45.0, -4.45), (60.0, -4.65), (90.0, -4.8)),
)
# After sunset the sky's brightness falls to a millionth, which no camera follows. The display value of the grey card
# under the sky alone is led from sunset's to night's instead: (altitude, card, card under Blender's sky, exposure 1).
TWILIGHT = (
    *((0.0, 0.127, 0.0636), (-1.0, 0.098, 0.0377), (-2.0, 0.076, 0.0198), (-3.0, 0.059, 0.00898)),
    *((-4.0, 0.046, 0.00341), (-6.0, 0.028, 0.00341), (-9.0, 0.014, 0.00341), (-12.0, 0.0065, 0.00341)),
    *((-15.0, 0.0025, 0.00341), (-18.0, 0.0001, 0.00341)),
)
LOWEST_SKY_DEG = -4.0  # below, Blender's sky is noise; its look is kept and dimmed
DAY_CARD = 0.25
SKY_SAMPLING_MAP = 256  # pixels across; the sun is sampled apart


def new_world() -> bpy.types.World:
    """A world for :func:`draw_sky`."""
    world = bpy.data.worlds.new("rauca weather")
    # No more noise than with Cycles' own choice, which spends 3.5 CPU seconds more on a closed cloud cover.
    world.cycles.sampling_method = "MANUAL"
    world.cycles.sample_map_resolution = SKY_SAMPLING_MAP
    return world


def draw_sky(world: bpy.types.World, weather: contract.Weather) -> None:
    """Replace a world's nodes by the weather's sky, sun, clouds and the glow of the night; linear, before exposure."""
    tree = nodes.fresh_tree(world)
    altitude, cover = weather.sun_altitude_angle, weather.cloudiness / 100.0
    # None of the clear night sky's light is there by day, all from the end of twilight on.
    clear_night = float(np.clip(altitude / contract.weather.NIGHT_ALTITUDE_DEG, 0.0, 1.0)) ** 2
    night = clear_night * (1.0 - cover) + weather.lamps * cover
    glow = [n + (c - n) * cover for n, c in zip(NIGHT_SKY, NIGHT_CLOUDS, strict=True)]
    if altitude <= contract.weather.NIGHT_ALTITUDE_DEG:
        color: bpy.types.NodeSocket | tuple[float, ...] = (*glow, 1.0)
    else:
        color = _sky(tree, weather)
        if night > 0.0:
            color = nodes.compute_vector(tree, "ADD", color, [night * g for g in glow])
    background = nodes.add(tree, "ShaderNodeBackground", Color=color, Strength=1.0)
    tree.links.new(background.outputs[0], nodes.add(tree, "ShaderNodeOutputWorld").inputs["Surface"])


def film_exposure(weather: contract.Weather) -> float:
    """What Cycles' film multiplies light by in this weather."""
    return 2.0 ** exposure_stops(weather.sun_altitude_angle, weather.cloudiness / 100.0)


def exposure_stops(sun_altitude_deg: float, cover: float = 0.0) -> float:
    """Film exposure in powers of two for a sun altitude in degrees and a cloud cover in [0, 1].

    Clouds are compensated to six sevenths by day; when lamps light the street, nothing is.
    """
    altitudes, stops = zip(*EXPOSURE_STOPS, strict=True)
    lost = -math.log2(ground_share(cover)) * 6 / 7
    by_day = float(np.clip(1.0 + sun_altitude_deg / 12.0, 0.0, 1.0))
    return float(np.interp(sun_altitude_deg, altitudes, stops)) + lost * by_day


def _twilight(sun_altitude_deg: float, column: int, by_day: float) -> float:
    """A column of :data:`TWILIGHT`, interpolated in its logarithm; from sunset to 5 degrees it fades to the day."""
    rows = [*reversed(TWILIGHT), (5.0, by_day, by_day)]
    return float(np.exp(np.interp(sun_altitude_deg, [r[0] for r in rows], [math.log(r[column]) for r in rows])))


def _sky(tree: bpy.types.NodeTree, weather: contract.Weather) -> bpy.types.NodeSocket:
    """Linear radiance of the sky, the sun and the clouds."""
    altitude, cover = weather.sun_altitude_angle, weather.cloudiness / 100.0
    sky = nodes.add(tree, "ShaderNodeTexSky")
    sky.sky_type = compat.sky_texture_kind()
    sky.sun_elevation = math.radians(max(altitude, LOWEST_SKY_DEG))
    # Blender turns its sun clockwise from +y, the azimuth here goes counter-clockwise from +x.
    sky.sun_rotation = math.radians(90.0 - weather.sun_azimuth_angle)
    sky.sun_disc = sun_share(cover) > 0.0
    color = sky.outputs[0]
    if altitude < 0.0:
        natural = _twilight(altitude, 2, 1.0) * 2.0 ** exposure_stops(altitude)
        color = nodes.compute_vector(tree, "SCALE", color, _twilight(altitude, 1, 1.0) / natural)
    if cover > 0.0:
        sky.sun_intensity = sun_share(cover)
        sky.sun_size = math.radians(sun_diameter_deg(cover))
        color = _clouds(tree, color, weather)
    return color


LAYER_CURVATURE = 0.14  # keeps the layer's texture from shrinking to nothing at the horizon
SCALE = 0.9  # clouds per height of the layer
SUN_WIDENING_DEG = 7.0  # added to the sun's diameter under a full cover
SUN_DIAMETER_DEG = 0.545
GREY_CARD = 0.18
# Radiance of clouds in terms of a white surface under the clear sky: sunlit heaps, and a closed cover from below.
SUNLIT, CLOSED = 0.85, 0.25
SHADE_CONTRAST = 0.22  # of a cloud's own light and dark


def ground_share(cover: float) -> float:
    """Light on level ground as a share of the clear sky's; ``cover`` in [0, 1]."""
    return 1.0 - 0.75 * cover**3.4


def sun_share(cover: float) -> float:
    """Direct sunlight that comes through, 1 to 0."""
    share = (1.0 - cover**2) ** 2
    return share if share > 0.01 else 0.0


def sun_diameter_deg(cover: float) -> float:
    """Angular diameter of the sun seen through the clouds."""
    return SUN_DIAMETER_DEG + SUN_WIDENING_DEG * cover**2


def toward_sun(weather: contract.Weather) -> tuple[float, float, float]:
    """Unit vector to the sun."""
    up, around = math.radians(weather.sun_altitude_angle), math.radians(weather.sun_azimuth_angle)
    return math.cos(up) * math.cos(around), math.cos(up) * math.sin(around), math.sin(up)


def _clouds(tree: bpy.types.NodeTree, sky: bpy.types.NodeSocket, weather: contract.Weather) -> bpy.types.NodeSocket:
    """Linear radiance of sky and clouds, from that of the clear sky with the dimmed sun in it."""
    cover = weather.cloudiness / 100.0
    toward = nodes.add(tree, "ShaderNodeTexCoord").outputs["Generated"]
    parts = nodes.add(tree, "ShaderNodeSeparateXYZ", Vector=toward).outputs
    height = nodes.compute(tree, "ADD", nodes.compute(tree, "MAXIMUM", parts["Z"], 0.0), LAYER_CURVATURE)
    layer = nodes.add(
        tree,
        "ShaderNodeCombineXYZ",
        X=nodes.compute(tree, "DIVIDE", parts["X"], height),
        Y=nodes.compute(tree, "DIVIDE", parts["Y"], height),
        Z=0.37,
    )
    noise = nodes.add(tree, "ShaderNodeTexNoise", Vector=layer.outputs[0], Scale=SCALE, Detail=6.0, Roughness=0.55)
    # Noise lies within 0.25 and 0.75, mostly: a cover of 1 closes the sky.
    level = 0.72 - 0.62 * cover
    thickness = nodes.compute(tree, "SUBTRACT", noise.outputs[0], level)
    opacity = nodes.compute(tree, "MULTIPLY", thickness, 1.0 / 0.15, clamp=True)
    if sun_share(cover) > 0.0:
        opacity = nodes.compute(tree, "MULTIPLY", opacity, _beside_sun(tree, toward, toward_sun(weather), cover))
    # Thick parts are darker, as seen from below; a low sun warms broken clouds.
    altitude, open_sky = weather.sun_altitude_angle, 1.0 - cover**2
    card = _twilight(altitude, 1, DAY_CARD) / 2.0 ** exposure_stops(altitude)  # under the clear sky, before exposure
    level = card / GREY_CARD * (CLOSED + (SUNLIT - CLOSED) * open_sky)
    warmth = open_sky * max(0.0, 1.0 - abs(altitude - 1.0) / 14.0)
    tint = (1.0 + 0.25 * warmth, 1.0 - 0.06 * warmth, 1.03 - 0.33 * warmth)
    bright = (*(level * (1.0 + SHADE_CONTRAST) * c for c in tint), 1.0)
    dark = (*(level * (1.0 - SHADE_CONTRAST) * c for c in tint), 1.0)
    depth = nodes.compute(tree, "MULTIPLY_ADD", noise.outputs[0], 2.5, -0.75, clamp=True)
    return nodes.mix_color(tree, opacity, sky, nodes.mix_color(tree, depth, bright, dark))


def _beside_sun(
    tree: bpy.types.NodeTree, toward: bpy.types.NodeSocket, sun: tuple[float, float, float], cover: float
) -> bpy.types.NodeSocket:
    """0 over the sun's disc, 1 beside it."""
    radius = math.radians(sun_diameter_deg(cover) / 2)
    inner, outer = math.cos(radius * 1.05), math.cos(radius * 1.35)
    from_disc = nodes.compute(tree, "SUBTRACT", inner, nodes.compute_vector(tree, "DOT_PRODUCT", toward, sun))
    return nodes.compute(tree, "DIVIDE", from_disc, inner - outer, clamp=True)
