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
        feed(tree, node.inputs[name.replace("_", " ")], value)
    return node


def group(name: str, inputs: dict[str, str], outputs: dict[str, str]) -> bpy.types.NodeTree:
    """A new node group with sockets of these names and kinds: Color, Float, Vector."""
    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
    for way, sockets in (("INPUT", inputs), ("OUTPUT", outputs)):
        for socket, kind in sockets.items():
            tree.interface.new_socket(socket, in_out=way, socket_type=f"NodeSocket{kind}")
    return tree


def number(tree: bpy.types.NodeTree, name: str, value: float = 0.0) -> bpy.types.NodeSocket:
    """A number that :func:`set_number` changes; returns its socket."""
    node = add(tree, "ShaderNodeValue")
    node.name, node.outputs[0].default_value = name, value
    return node.outputs[0]


def set_number(tree: bpy.types.NodeTree, name: str, value: float) -> None:
    """Change a :func:`number`."""
    tree.nodes[name].outputs[0].default_value = value


def texture(tree: bpy.types.NodeTree, image: bpy.types.Image | None, uv: str | bpy.types.NodeSocket) -> bpy.types.Node:
    """An image in the UV layer ``uv``, or at a socket's place, interpolated as the renderer does; its edge goes on."""
    if isinstance(uv, str):
        layer = add(tree, "ShaderNodeUVMap")
        layer.uv_map, uv = uv, layer.outputs[0]
    node = add(tree, "ShaderNodeTexImage", Vector=uv)
    node.image, node.interpolation, node.extension = image, "Linear", "EXTEND"
    return node


def principled(tree: bpy.types.NodeTree) -> bpy.types.Node:
    """The Principled BSDF of a tree that has one, by its type: its name is in the language of the user's Blender."""
    return next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")


def principled_surface(tree: bpy.types.NodeTree, **inputs: Any) -> bpy.types.Node:
    """Make a Principled BSDF with these inputs the tree's surface."""
    shader = add(tree, "ShaderNodeBsdfPrincipled", **inputs)
    output(tree, Surface=shader.outputs[0])
    return shader


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
