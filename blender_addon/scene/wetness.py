"""Water on surfaces: wet, they are darker where they are porous, and glossier; puddles lie on what faces up.

Every wettable material holds the same node group, so one call wets the scene. Dry, its outputs are its inputs, bit for
bit. A surface's color is only ever multiplied by a number that does not depend on it: light stays affine in a paint.
"""

from __future__ import annotations

from typing import Any

import bpy

from ..core import contract
from . import nodes

GROUP = "rauca wetness"

# Lagarde, "Water drop 3b: physically based wet surfaces" (2013): water in the pores of a surface traps light, which
# takes up to 80 % off its albedo.
PORE_DARKENING = 0.8
PUDDLE_ROUGHNESS = 0.02
RIPPLED_ROUGHNESS = 0.14  # of a puddle in heavy rain

PUDDLE_NOISE_PER_M = 0.45
PUDDLE_FLATNESS = 0.97  # cosine of the steepest slope that holds a puddle
# Puddles fill the noise up to a level that their amount moves; at 1 they cover five sixths of the ground.
PUDDLE_LEVEL_EMPTY, PUDDLE_LEVEL_FULL, PUDDLE_EDGE = 0.27, 0.6, 0.05


def wet(
    tree: bpy.types.NodeTree, color: Any, roughness: Any, porosity: float
) -> tuple[bpy.types.NodeSocket, bpy.types.NodeSocket]:
    """Put the scene's water on a surface.

    Args:
        color: linear albedo, a socket or RGBA.
        porosity: how much water gets into it, 0 to 1; 0 is paint, glass, metal and plastic, whose color does not change
            and which hold no puddles.

    Returns:
        The sockets to link to the shader's base color and roughness.
    """
    node = nodes.add(tree, "ShaderNodeGroup")
    node.node_tree = _group()
    for name, value in (("Color", color), ("Roughness", roughness), ("Porosity", porosity)):
        nodes.feed(tree, node.inputs[name], value)
    return node.outputs["Color"], node.outputs["Roughness"]


def set_wetness(wetness: float, puddles: float, ripples: float = 0.0) -> None:
    """Wet every surface that went through :func:`wet`, in every scene.

    Args:
        wetness: 0 (dry) to 1 (a film of water on all that faces the sky).
        puddles: 0 to 1, how much of the flat porous ground lies under water.
        ripples: 0 to 1, how far falling rain breaks the mirror of puddles.
    """
    group = _group()
    nodes.set_number(group, "wetness", wetness)
    nodes.set_number(group, "puddles", puddles)
    roughness = PUDDLE_ROUGHNESS + (RIPPLED_ROUGHNESS - PUDDLE_ROUGHNESS) * ripples
    nodes.set_number(group, "puddle roughness", roughness)


def _group() -> bpy.types.NodeTree:
    known = bpy.data.node_groups.get(GROUP)
    if known is not None:
        return known
    colors = {"Color": "Color", "Roughness": "Float"}
    tree = nodes.group(GROUP, {**colors, "Porosity": "Float"}, colors)
    surface = nodes.add(tree, "NodeGroupInput").outputs
    wetness, puddles = nodes.number(tree, "wetness"), nodes.number(tree, "puddles")
    smooth = nodes.number(tree, "puddle roughness", PUDDLE_ROUGHNESS)
    geometry = nodes.add(tree, "ShaderNodeNewGeometry")
    up = nodes.add(tree, "ShaderNodeSeparateXYZ", Vector=geometry.outputs["Normal"]).outputs["Z"]
    facing = nodes.compute(
        tree, "MULTIPLY_ADD", up, 1.0 - contract.finish.WALL_SHARE, contract.finish.WALL_SHARE, clamp=True
    )
    film = nodes.compute(tree, "MULTIPLY", facing, wetness)
    puddle = _puddle_mask(tree, puddles, geometry.outputs["Position"], up, surface["Porosity"])
    soaked = nodes.compute(tree, "MAXIMUM", film, puddle)

    lost = nodes.compute(tree, "MULTIPLY", nodes.compute(tree, "MULTIPLY", soaked, surface["Porosity"]), PORE_DARKENING)
    kept = nodes.compute(tree, "SUBTRACT", 1.0, lost)
    darker = nodes.compute_vector(tree, "SCALE", surface["Color"], kept)
    filmed = _towards(tree, surface["Roughness"], contract.finish.FILM_ROUGHNESS, film)
    glossier = _towards(tree, filmed, smooth, puddle)
    nodes.add(tree, "NodeGroupOutput", Color=darker, Roughness=glossier)
    return tree


def _puddle_mask(
    tree: bpy.types.NodeTree,
    amount: bpy.types.NodeSocket,
    position: bpy.types.NodeSocket,
    up: bpy.types.NodeSocket,
    porosity: bpy.types.NodeSocket,
) -> bpy.types.NodeSocket:
    """1 under water, 0 elsewhere."""
    noise = nodes.add(tree, "ShaderNodeTexNoise", Vector=position, Scale=PUDDLE_NOISE_PER_M, Detail=3.0)
    level = nodes.compute(tree, "MULTIPLY_ADD", amount, PUDDLE_LEVEL_FULL - PUDDLE_LEVEL_EMPTY, PUDDLE_LEVEL_EMPTY)
    depth = nodes.compute(tree, "SUBTRACT", level, noise.outputs[0])
    filled = nodes.compute(tree, "MULTIPLY", depth, 1.0 / PUDDLE_EDGE, clamp=True)
    flat = nodes.compute(tree, "GREATER_THAN", up, PUDDLE_FLATNESS)
    holding = nodes.compute(tree, "MULTIPLY", flat, nodes.compute(tree, "MULTIPLY", porosity, 4.0, clamp=True))
    # Nothing at all in dry weather: the product folds to zero and the noise is never evaluated.
    some = nodes.compute(tree, "MULTIPLY", amount, 50.0, clamp=True)
    return nodes.compute(tree, "MULTIPLY", nodes.compute(tree, "MULTIPLY", filled, holding), some)


def _towards(
    tree: bpy.types.NodeTree, value: bpy.types.NodeSocket, smooth: Any, share: bpy.types.NodeSocket
) -> bpy.types.NodeSocket:
    """``value`` moved by ``share`` to ``smooth``; surfaces smoother than that stay."""
    lower = nodes.compute(tree, "MINIMUM", value, smooth)
    change = nodes.compute(tree, "SUBTRACT", lower, value)
    return nodes.compute(tree, "MULTIPLY_ADD", change, share, value)
