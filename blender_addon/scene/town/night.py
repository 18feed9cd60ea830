"""One switch for everything in the town that shines at night without being a lamp: lit windows, signs, lamp heads."""

from __future__ import annotations

import bpy

from .. import nodes

GROUP = "rauca night"


def glow(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    """How far the town is lit, 0 to 1: multiply an emission's strength by it."""
    node = nodes.add(tree, "ShaderNodeGroup")
    node.node_tree = _group()
    return node.outputs["Lit"]


def set_lit(level: float) -> None:
    """Turn up every material that went through :func:`glow`, in every scene: 0 (by day) to 1."""
    _group().nodes["lit"].outputs[0].default_value = level


def _group() -> bpy.types.NodeTree:
    known = bpy.data.node_groups.get(GROUP)
    if known is not None:
        return known
    tree = bpy.data.node_groups.new(GROUP, "ShaderNodeTree")
    tree.interface.new_socket("Lit", in_out="OUTPUT", socket_type="NodeSocketFloat")
    value = nodes.add(tree, "ShaderNodeValue")
    value.name, value.outputs[0].default_value = "lit", 0.0
    nodes.add(tree, "NodeGroupOutput", Lit=value.outputs[0])
    return tree
