"""Blender materials of the town's surfaces and windows, made when first asked for; one switch for all that shines."""

from __future__ import annotations

from typing import Any

import bpy

from .. import nodes
from ..wetness import wet
from .tables import GLAZINGS, SURFACES, Albedo, Glazing, Surface

NIGHT_GROUP = "rauca night"


def glow(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    """How far the town is lit, 0 to 1: multiply an emission's strength by it."""
    node = nodes.add(tree, "ShaderNodeGroup")
    node.node_tree = _group()
    return node.outputs["Lit"]


def set_lit(level: float) -> None:
    """Turn up every material that went through :func:`glow`, in every scene: 0 (by day) to 1."""
    nodes.set_number(_group(), "lit", level)


def _group() -> bpy.types.NodeTree:
    known = bpy.data.node_groups.get(NIGHT_GROUP)
    if known is not None:
        return known
    tree = nodes.group(NIGHT_GROUP, {}, {"Lit": "Float"})
    nodes.add(tree, "NodeGroupOutput", Lit=nodes.number(tree, "lit"))
    return tree


GLASS_ALBEDO: Albedo = (0.018, 0.022, 0.026)
CURTAIN_ALBEDO: Albedo = (0.30, 0.28, 0.24)
LIT_RADIANCE = 0.36  # of a lit window at its top, before the film's exposure; a lamp-lit pavement has about 0.1
LIT_COLORS: tuple[Albedo, Albedo] = ((1.0, 0.62, 0.28), (0.95, 0.88, 0.75))


class Materials(dict[str, bpy.types.Material]):
    """Materials by the names of :data:`SURFACES` and :data:`GLAZINGS`."""

    def __missing__(self, name: str) -> bpy.types.Material:
        glazing = GLAZINGS.get(name)
        shows_as = "window" if glazing else SURFACES[name].shows_as
        material = bpy.data.materials.new(f"rauca {name}")
        material["rauca_class"] = shows_as
        # Windows and signs are seen and reflected, but not sampled as lamps: they are faint and many.
        material.cycles.emission_sampling = "NONE"
        tree = nodes.fresh_tree(material)
        if glazing:
            _window(tree, glazing)
        else:
            _surface(tree, SURFACES[name])
        self[name] = material
        return material


def _scaled(albedo: Albedo, factor: float) -> tuple[float, float, float, float]:
    red, green, blue = (min(c * factor, 0.9) for c in albedo)
    return red, green, blue, 1.0


def _surface(tree: bpy.types.NodeTree, spec: Surface) -> None:
    color: Any = _scaled(spec.albedo, 1.0)
    if spec.contrast:
        position = nodes.add(tree, "ShaderNodeNewGeometry").outputs["Position"]
        noise = nodes.add(tree, "ShaderNodeTexNoise", Vector=position, Scale=spec.noise_per_m, Detail=2.0)
        dark, light = _scaled(spec.albedo, 1 - spec.contrast), _scaled(spec.albedo, 1 + spec.contrast)
        color = nodes.mix_color(tree, noise.outputs[0], dark, light)
    if spec.joints[0]:
        color = _jointed(tree, spec, color)
    color, roughness = wet(tree, color, spec.roughness, spec.porosity)
    shader = nodes.principled_surface(tree, Base_Color=color, Roughness=roughness, Metallic=spec.metallic)
    if spec.glow:
        strength = nodes.compute(tree, "MULTIPLY", glow(tree), spec.glow)
        tree.links.new(strength, shader.inputs["Emission Strength"])
        shader.inputs["Emission Color"].default_value = (1.0, 0.82, 0.6, 1.0)


def _jointed(tree: bpy.types.NodeTree, spec: Surface, color: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Stones that differ a little in albedo, with joints between them."""
    width, height, joint = spec.joints
    uv = nodes.add(tree, "ShaderNodeUVMap").outputs[0]
    stones = nodes.add(
        tree,
        "ShaderNodeTexBrick",
        Vector=uv,
        Color1=(0.85, 0.85, 0.85, 1.0),
        Color2=(1.15, 1.15, 1.15, 1.0),
        Mortar=(spec.joint_shade, spec.joint_shade, spec.joint_shade, 1.0),
        Scale=1.0,
        Mortar_Size=joint / 2,
        Mortar_Smooth=0.2,
        Brick_Width=width,
        Row_Height=height,
    )
    return nodes.compute_vector(tree, "MULTIPLY", color, stones.outputs["Color"])


def _window(tree: bpy.types.NodeTree, spec: Glazing) -> None:
    """A pane in its frame: curtains by day behind some, light after dark behind others."""
    uv = nodes.add(tree, "ShaderNodeSeparateXYZ", Vector=nodes.add(tree, "ShaderNodeUVMap").outputs[0]).outputs
    cell = nodes.compute_vector(tree, "FLOOR", nodes.add(tree, "ShaderNodeUVMap").outputs[0])
    chance = nodes.add(tree, "ShaderNodeTexWhiteNoise", Vector=cell)
    chance.noise_dimensions = "2D"
    frame = _frame(tree, spec, uv["X"], uv["Y"])
    other = nodes.add(tree, "ShaderNodeSeparateColor", Color=chance.outputs["Color"]).outputs
    curtained = nodes.compute(tree, "LESS_THAN", other[0], spec.curtained)
    behind = nodes.mix_color(tree, curtained, (*GLASS_ALBEDO, 1.0), (*CURTAIN_ALBEDO, 1.0))
    color = nodes.mix_color(tree, frame, behind, (*spec.frame, 1.0))
    roughness = nodes.compute(tree, "MULTIPLY_ADD", frame, 0.5, 0.06)
    lit = nodes.compute(tree, "LESS_THAN", chance.outputs["Value"], spec.lit_share)
    open_to_view = nodes.compute(tree, "SUBTRACT", 1.0, frame)
    bright = nodes.compute(tree, "MULTIPLY", nodes.compute(tree, "MULTIPLY", lit, open_to_view), glow(tree))
    height = nodes.compute(tree, "FRACT", uv["Y"])
    from_above = nodes.compute(tree, "MULTIPLY_ADD", height, 0.65 * LIT_RADIANCE, 0.35 * LIT_RADIANCE)
    nodes.principled_surface(
        tree,
        Base_Color=color,
        Roughness=roughness,
        Emission_Color=nodes.mix_color(tree, other[1], (*LIT_COLORS[0], 1.0), (*LIT_COLORS[1], 1.0)),
        Emission_Strength=nodes.compute(tree, "MULTIPLY", bright, from_above),
    )


def _frame(
    tree: bpy.types.NodeTree, spec: Glazing, u: bpy.types.NodeSocket, v: bpy.types.NodeSocket
) -> bpy.types.NodeSocket:
    """1 on the frame and its bars, 0 on the glass."""
    half = 0.5 - spec.frame_share
    marks = []
    for axis, bar_at in ((u, 0.5), (v, 0.66)):
        along = nodes.compute(tree, "FRACT", axis)
        from_middle = nodes.compute(tree, "ABSOLUTE", nodes.compute(tree, "SUBTRACT", along, 0.5))
        marks.append(nodes.compute(tree, "GREATER_THAN", from_middle, half))
        if spec.bars:
            from_bar = nodes.compute(tree, "ABSOLUTE", nodes.compute(tree, "SUBTRACT", along, bar_at))
            marks.append(nodes.compute(tree, "LESS_THAN", from_bar, spec.frame_share / 2))
    result = marks[0]
    for mark in marks[1:]:
        result = nodes.compute(tree, "MAXIMUM", result, mark)
    return result
