"""Shader trees in a few words."""

from __future__ import annotations

from typing import Any

import bpy


def fresh_tree(owner: bpy.types.Material | bpy.types.World) -> bpy.types.NodeTree:
    """The node tree of a material or world, emptied."""
    if owner.node_tree is None:  # from 5.0 they are born with one
        owner.use_nodes = True
    owner.node_tree.nodes.clear()
    return owner.node_tree


def add(tree: bpy.types.NodeTree, kind: str, **inputs: Any) -> bpy.types.Node:
    """Add a node; keyword arguments set inputs by name (underscores for spaces): a value, or a socket to link."""
    node = tree.nodes.new(kind)
    for name, value in inputs.items():
        socket = node.inputs[name.replace("_", " ")]
        feed(tree, socket, value)
    return node


def principled(tree: bpy.types.NodeTree) -> bpy.types.Node:
    """The Principled BSDF of a tree that has one, by its type: its name is in the language of the user's Blender."""
    return next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")


def mix_color(tree: bpy.types.NodeTree, factor: Any, first: Any, second: Any) -> bpy.types.NodeSocket:
    """``first * (1 - factor) + second * factor`` per channel, unclamped; returns the color socket."""
    node = tree.nodes.new("ShaderNodeMix")
    node.data_type, node.clamp_factor = "RGBA", False
    # The node has a socket of every data type under the same names; these are the RGBA ones.
    for index, value in ((0, factor), (6, first), (7, second)):
        feed(tree, node.inputs[index], value)
    return node.outputs[2]


def output(tree: bpy.types.NodeTree, **shaders: bpy.types.NodeSocket) -> None:
    """Add the output node; keywords are its sockets: Surface, Volume."""
    add(tree, "ShaderNodeOutputMaterial", **shaders)


def compute(tree: bpy.types.NodeTree, operation: str, *values: Any, clamp: bool = False) -> bpy.types.NodeSocket:
    """A Math node, e.g. ``compute(tree, "MULTIPLY", socket, 0.5)``; ``clamp`` limits the result to [0, 1]."""
    node = tree.nodes.new("ShaderNodeMath")
    node.operation, node.use_clamp = operation, clamp
    for socket, value in zip(node.inputs, values, strict=False):  # the node always has three inputs
        feed(tree, socket, value)
    return node.outputs[0]


def compute_vector(tree: bpy.types.NodeTree, operation: str, first: Any, second: Any = None) -> bpy.types.NodeSocket:
    """A Vector Math node, e.g. ``compute_vector(tree, "SCALE", color, 0.5)``."""
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = operation
    feed(tree, node.inputs[0], first)
    if second is not None:
        feed(tree, node.inputs["Scale" if operation == "SCALE" else 1], second)
    return node.outputs["Value" if operation == "DOT_PRODUCT" else "Vector"]


def feed(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, value: Any) -> None:
    """Link a socket to another node's output, or set its value."""
    if isinstance(value, bpy.types.NodeSocket):
        tree.links.new(value, socket)
    else:
        socket.default_value = value
