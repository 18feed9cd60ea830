"""The camouflage as a coat over a material of the artist's: a node group before the shader, taken out without a trace.

The material keeps its name, its slots and all its nodes. The group lets the original color through wherever a face is
not painted or the paint mask is black, so a material that other parts share stays theirs.
"""

from __future__ import annotations

import bpy

from .. import compat
from ..core import contract
from . import nodes

PAINTED = "rauca_painted"  # float attribute of faces: 1 where the coat lies
GROUP = "rauca camouflage"
NODE = "rauca camouflage"  # of the group's node in a material
ATLAS_NODE, BAKED_NODE = "rauca atlas UVs", "rauca baked UVs"
SHOWN = {"ORIGINAL": 0, "CAMOUFLAGE": 1, "BAKED": 2}


class Coat:
    """The node group of one vehicle's camouflage."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self.tree = tree

    @staticmethod
    def new(camouflage: bpy.types.Image, mask: bpy.types.Image) -> Coat:
        """A coat that shows ``camouflage`` where ``mask`` is white; float images in linear light."""
        tree = bpy.data.node_groups.new(GROUP, "ShaderNodeTree")
        for name, kind, way in (
            *(("Color", "Color", "INPUT"), ("Metallic", "Float", "INPUT")),
            *(("Atlas UV", "Vector", "INPUT"), ("Baked UV", "Vector", "INPUT")),
            *(("Color", "Color", "OUTPUT"), ("Metallic", "Float", "OUTPUT")),
        ):
            tree.interface.new_socket(name, in_out=way, socket_type=f"NodeSocket{kind}")
        given = nodes.add(tree, "NodeGroupInput").outputs
        painted = nodes.add(tree, "ShaderNodeAttribute")
        painted.attribute_name = PAINTED
        shown = nodes.add(tree, "ShaderNodeValue")
        shown.name = "shown"
        coated = nodes.compute(tree, "GREATER_THAN", shown.outputs[0], 0.5)
        baked = nodes.compute(tree, "GREATER_THAN", shown.outputs[0], 1.5)
        here = nodes.compute(tree, "MULTIPLY", painted.outputs["Fac"], coated)
        masked = nodes.compute(tree, "MULTIPLY", here, _image(tree, "mask", given["Atlas UV"], mask))
        direct = nodes.mix_color(
            tree, masked, given["Color"], _image(tree, "camouflage", given["Atlas UV"], camouflage)
        )
        carried = nodes.mix_color(tree, here, given["Color"], _image(tree, "baked", given["Baked UV"], None))
        nodes.add(
            tree,
            "NodeGroupOutput",
            Color=nodes.mix_color(tree, baked, direct, carried),
            # A metal tints its highlights: radiance would no longer be affine in the color.
            Metallic=nodes.compute(tree, "MULTIPLY", given["Metallic"], nodes.compute(tree, "SUBTRACT", 1.0, masked)),
        )
        coat = Coat(tree)
        coat.show("CAMOUFLAGE")
        return coat

    @property
    def shown(self) -> str:
        """One of :data:`SHOWN`."""
        value = round(self.tree.nodes["shown"].outputs[0].default_value)
        return next(name for name, number in SHOWN.items() if number == value)

    def show(self, which: str) -> None:
        """Show the original paint, the camouflage, or the baked picture."""
        self.tree.nodes["shown"].outputs[0].default_value = float(SHOWN[which])

    def image(self, which: str) -> bpy.types.Image | None:
        """The image ``camouflage``, ``mask`` or ``baked``."""
        return self.tree.nodes[which].image

    def set_baked(self, image: bpy.types.Image, wraps: bool) -> None:
        """The picture in another UV layout; ``wraps`` where its UVs lie in several tiles."""
        node = self.tree.nodes["baked"]
        node.image, node.extension = image, "REPEAT" if wraps else "EXTEND"


def coat_of(material: bpy.types.Material | None) -> Coat | None:
    """The coat on a material, or None."""
    tree = material.node_tree if material is not None else None
    node = tree.nodes.get(NODE) if tree is not None else None
    return Coat(node.node_tree) if node is not None and node.type == "GROUP" and node.node_tree is not None else None


def require_coatable(material: bpy.types.Material | None, where: str) -> bpy.types.Material:
    """The material, if it can take a coat.

    Raises:
        RaucaError: there is none, it is linked from another file, or it has no Principled BSDF.
    """
    if material is None:
        raise contract.RaucaError(f"{where}: its paint has no material; give it one with a Principled BSDF")
    if material.library is not None:
        raise contract.RaucaError(
            f"{material.name}: is linked from {material.library.filepath}; Object > Relations > Make Local > All first"
        )
    if not _shaders(material):
        raise contract.RaucaError(f"{material.name}: has no Principled BSDF; use one for the paint's surface")
    return material


def put_on(material: bpy.types.Material, coat: Coat, atlas_layer: str) -> None:
    """Put a coat on a material, instead of any other; its UVs are in ``atlas_layer``."""
    take_off(material)
    tree = material.node_tree
    for shader in _shaders(material):
        group = nodes.add(tree, "ShaderNodeGroup")
        group.node_tree, group.name, group.label = coat.tree, NODE, "Camouflage"
        group.location = (shader.location.x - 200, shader.location.y + 40)
        for name, key in ((ATLAS_NODE, "Atlas UV"), (BAKED_NODE, "Baked UV")):
            uv = nodes.add(tree, "ShaderNodeUVMap")
            uv.name, uv.uv_map, uv.hide = name, atlas_layer, True
            uv.location = (group.location.x - 200, group.location.y - (160 if key == "Atlas UV" else 200))
            tree.links.new(uv.outputs[0], group.inputs[key])
        for here, name in (("Base Color", "Color"), ("Metallic", "Metallic")):
            _route(tree, shader.inputs[here], group, name)


def take_off(material: bpy.types.Material) -> None:
    """Take the coat off a material: its own color and metal are linked, or set, as they were."""
    tree = material.node_tree
    if tree is None:
        return
    for group in [n for n in tree.nodes if n.name.startswith(NODE) and n.type == "GROUP"]:
        for here, name in (("Base Color", "Color"), ("Metallic", "Metallic")):
            links = group.outputs[name].links
            shader = links[0].to_node if links else None
            source = group.inputs[name]
            if shader is None:
                continue
            if source.links:
                tree.links.new(source.links[0].from_socket, shader.inputs[here])
            else:
                tree.links.remove(links[0])
        tree.nodes.remove(group)
    for node in [n for n in tree.nodes if n.name.startswith((ATLAS_NODE, BAKED_NODE))]:
        tree.nodes.remove(node)


def atlas_layer(material: bpy.types.Material) -> str:
    """The UV layer in which the coat on a material reads the camouflage."""
    return material.node_tree.nodes[ATLAS_NODE].uv_map


def set_baked_layer(material: bpy.types.Material, layer: str) -> None:
    """The UV layer in which the coat on a material reads the baked picture."""
    for node in material.node_tree.nodes:
        if node.name.startswith(BAKED_NODE):
            node.uv_map = layer


def _route(tree: bpy.types.NodeTree, target: bpy.types.NodeSocket, group: bpy.types.Node, name: str) -> None:
    """Send what feeds ``target`` through the group; its own value stays, for when the group goes."""
    if target.links:
        tree.links.new(target.links[0].from_socket, group.inputs[name])
    else:
        group.inputs[name].default_value = target.default_value
    tree.links.new(group.outputs[name], target)


def _shaders(material: bpy.types.Material) -> list[bpy.types.Node]:
    tree = compat.shader_tree(material)
    return [node for node in tree.nodes if node.type == "BSDF_PRINCIPLED"] if tree is not None else []


def _image(
    tree: bpy.types.NodeTree, name: str, uv: bpy.types.NodeSocket, image: bpy.types.Image | None
) -> bpy.types.NodeSocket:
    node = nodes.add(tree, "ShaderNodeTexImage", Vector=uv)
    node.name, node.image, node.interpolation, node.extension = name, image, "Linear", "EXTEND"
    return node.outputs["Color"]
