"""Clouds: a layer drawn by noise in the sky, and what it does to the sun.

Light on the ground follows Kasten and Czeplak (1980): a share of 1 - 0.75 c^3.4 of the clear sky's under a cloud cover
c. The sun is dimmed and widened by the cover as a whole, wherever the drawn clouds stand: a frame's shadows must not
depend on whether one of them happens to cross the sun.
"""

from __future__ import annotations

import math

import bpy

from . import nodes

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


def draw(
    tree: bpy.types.NodeTree,
    sky: bpy.types.NodeSocket,
    cover: float,
    card: float,
    sun: tuple[float, float, float],
    sun_altitude_deg: float,
) -> bpy.types.NodeSocket:
    """Put clouds before a sky.

    Args:
        sky: linear radiance of the clear sky with the dimmed sun in it.
        cover: in (0, 1].
        card: radiance of an 18 % grey card on the ground under the clear sky, in the sky's units.
        sun: unit vector to the sun.

    Returns:
        Linear radiance of sky and clouds.
    """
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
        opacity = nodes.compute(tree, "MULTIPLY", opacity, _beside_sun(tree, toward, sun, cover))
    return nodes.mix_color(tree, opacity, sky, _radiance(tree, noise.outputs[0], cover, card, sun_altitude_deg))


def _radiance(
    tree: bpy.types.NodeTree, noise: bpy.types.NodeSocket, cover: float, card: float, sun_altitude_deg: float
) -> bpy.types.NodeSocket:
    """Thick parts are darker, as seen from below; a low sun warms broken clouds."""
    open_sky = 1.0 - cover**2
    level = card / GREY_CARD * (CLOSED + (SUNLIT - CLOSED) * open_sky)
    warmth = open_sky * max(0.0, 1.0 - abs(sun_altitude_deg - 1.0) / 14.0)
    tint = (1.0 + 0.25 * warmth, 1.0 - 0.06 * warmth, 1.03 - 0.33 * warmth)
    bright = (*(level * (1.0 + SHADE_CONTRAST) * c for c in tint), 1.0)
    dark = (*(level * (1.0 - SHADE_CONTRAST) * c for c in tint), 1.0)
    depth = nodes.compute(tree, "MULTIPLY_ADD", noise, 2.5, -0.75, clamp=True)
    return nodes.mix_color(tree, depth, bright, dark)


def _beside_sun(
    tree: bpy.types.NodeTree, toward: bpy.types.NodeSocket, sun: tuple[float, float, float], cover: float
) -> bpy.types.NodeSocket:
    """0 over the sun's disc, 1 beside it."""
    radius = math.radians(sun_diameter_deg(cover) / 2)
    inner, outer = math.cos(radius * 1.05), math.cos(radius * 1.35)
    along = nodes.add(tree, "ShaderNodeVectorMath")
    along.operation = "DOT_PRODUCT"
    tree.links.new(toward, along.inputs[0])
    along.inputs[1].default_value = sun
    from_disc = nodes.compute(tree, "SUBTRACT", inner, along.outputs["Value"])
    return nodes.compute(tree, "DIVIDE", from_disc, inner - outer, clamp=True)
