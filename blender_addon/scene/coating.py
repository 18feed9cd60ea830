"""A camouflage on the objects of a vehicle in the open scene, as a coat over their materials, and off without a trace.

The coat is a node group before each material's shader, and an attribute of the faces that says where it lies. Objects
keep their materials, slots and faces, materials all their nodes. The group lets the original color through wherever a
face is not painted or the paint mask is black, so a material that other parts share stays theirs.
"""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from .. import compat
from ..core import contract
from . import nodes
from .blocks import values_of
from .camouflages import Paintwork
from .images import mask_image, srgb_image
from .mesh_edits import Surface, require_own_faces, write_layer
from .paint import UV_LAYER
from .vehicle_arrays import PAINT_MARK, Piece

PAINTED = "rauca_painted"  # float attribute of faces: 1 where the coat lies
# Custom properties of the coat's node group: the camouflage's name, the UV layout it fits, and its texels' digest.
NAME_KEY, ATLAS_KEY, DIGEST_KEY = "rauca_camouflage", "rauca_atlas", "rauca_digest"
GROUP = "rauca camouflage"
NODE = "rauca camouflage"  # of the group's node in a material
ATLAS_NODE, BAKED_NODE = "rauca atlas UVs", "rauca baked UVs"
ROUTED = (("Base Color", "Color"), ("Metallic", "Metallic"))  # the shader's input, the group's socket
SHOWN = {"ORIGINAL": 0, "CAMOUFLAGE": 1, "BAKED": 2}


class Coat:
    """The node group of one vehicle's camouflage."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self.tree = tree

    @staticmethod
    def new(camouflage: bpy.types.Image, mask: bpy.types.Image) -> Coat:
        """A coat that shows ``camouflage`` where ``mask`` is white; float images in linear light."""
        color = {"Color": "Color", "Metallic": "Float"}
        tree = nodes.group(GROUP, {**color, "Atlas UV": "Vector", "Baked UV": "Vector"}, color)
        given = nodes.add(tree, "NodeGroupInput").outputs
        painted = nodes.add(tree, "ShaderNodeAttribute")
        painted.attribute_name = PAINTED
        shown = nodes.number(tree, "shown")
        picture = {}
        for name, uv, image in (
            ("mask", "Atlas UV", mask), ("camouflage", "Atlas UV", camouflage), ("baked", "Baked UV", None),
        ):  # fmt: skip
            node = nodes.texture(tree, image, given[uv])
            node.name, picture[name] = name, node.outputs["Color"]
        coated = nodes.compute(tree, "GREATER_THAN", shown, 0.5)
        baked = nodes.compute(tree, "GREATER_THAN", shown, 1.5)
        here = nodes.compute(tree, "MULTIPLY", painted.outputs["Fac"], coated)
        masked = nodes.compute(tree, "MULTIPLY", here, picture["mask"])
        direct = nodes.mix_color(tree, masked, given["Color"], picture["camouflage"])
        carried = nodes.mix_color(tree, here, given["Color"], picture["baked"])
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
        nodes.set_number(self.tree, "shown", SHOWN[which])

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
    """The material; :class:`RaucaError` if there is none, it is linked, or it has no Principled BSDF for a coat."""
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
        for here, name in ROUTED:
            target = shader.inputs[here]
            if target.links:
                tree.links.new(target.links[0].from_socket, group.inputs[name])
            else:  # its own value stays, for when the group goes
                group.inputs[name].default_value = target.default_value
            tree.links.new(group.outputs[name], target)


def take_off(material: bpy.types.Material) -> None:
    """Take the coat off a material: its own color and metal are linked, or set, as they were."""
    tree = material.node_tree
    if tree is None:
        return
    for group in [n for n in tree.nodes if n.name.startswith(NODE) and n.type == "GROUP"]:
        for here, name in ROUTED:
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


def set_baked_layer(material: bpy.types.Material, layer: str) -> None:
    """The UV layer in which the coat on a material reads the baked picture."""
    for node in material.node_tree.nodes:
        if node.name.startswith(BAKED_NODE):
            node.uv_map = layer


def _shaders(material: bpy.types.Material) -> list[bpy.types.Node]:
    tree = compat.shader_tree(material)
    return [node for node in tree.nodes if node.type == "BSDF_PRINCIPLED"] if tree is not None else []


def paint_surface(surface: Surface, paintwork: Paintwork) -> Coat:
    """Put a camouflage that fits on the objects of a vehicle; a coat that they wear is replaced.

    Raises:
        RaucaError: a mesh or material that cannot be changed, in words that say what to do; nothing was changed.
    """
    pieces = surface.painted_pieces()
    layers = [_existing_layer(surface, piece) for piece in pieces]
    polygons = [_painted_polygons(surface, piece) for piece in pieces]
    _check(surface, pieces, layers, polygons)
    uncoat([piece.owner for piece in pieces])
    for piece, layer, painted in zip(pieces, layers, polygons, strict=True):
        if layer is None:
            write_layer(piece, surface.paint[piece.span], surface.vehicle.uvs[piece.span])
        assert painted is not None  # _check saw to it
        mesh = piece.owner.data
        mark = mesh.attributes.get(PAINTED) or mesh.attributes.new(PAINTED, "FLOAT", "FACE")
        mark.data.foreach_set("value", painted.astype(np.float32))
        mesh.update()
    images = srgb_image("rauca camouflage", paintwork.uv_map_srgb), mask_image(surface.vehicle.paint_mask)
    for image in images:
        image.pack()
    coat = Coat.new(*images)
    coat.tree[NAME_KEY], coat.tree[ATLAS_KEY] = paintwork.name, surface.vehicle.atlas_id
    coat.tree[DIGEST_KEY] = paintwork.digest
    for piece, layer in zip(pieces, layers, strict=True):
        for material in surface.materials(piece):
            put_on(material, coat, layer or UV_LAYER)
    return coat


def uncoat(objects: list[bpy.types.Object]) -> None:
    """Take the camouflage off objects, and what it brought out of the file."""
    coats = set()
    for thing in objects:
        for slot in thing.material_slots:
            coat = coat_of(slot.material)
            if coat is not None:
                take_off(slot.material)
                coats.add(coat.tree)
        mark = thing.data.attributes.get(PAINTED) if thing.type == "MESH" else None
        if mark is not None and thing.data.library is None:
            thing.data.attributes.remove(mark)
    for tree in coats:
        images = [Coat(tree).image(which) for which in ("camouflage", "mask", "baked")]
        if tree.users <= 1:  # the panel's own pointer to it
            bpy.data.node_groups.remove(tree)
            for image in images:
                if image is not None and image.users == 0:
                    bpy.data.images.remove(image)


def atlas_layers(thing: bpy.types.Object) -> set[str]:
    """The UV layers that the camouflage of an object's materials lies in; asks no faces."""
    trees = [slot.material.node_tree for slot in thing.material_slots if slot.material is not None]
    return {node.uv_map for tree in trees if tree is not None and (node := tree.nodes.get(ATLAS_NODE)) is not None}


def painted_objects(scene: bpy.types.Scene, coat: Coat) -> list[bpy.types.Object]:
    """The objects that wear a coat."""
    return [
        thing
        for thing in scene.objects
        if any((worn := coat_of(slot.material)) is not None and worn.tree == coat.tree for slot in thing.material_slots)
    ]


def _existing_layer(surface: Surface, piece: Piece) -> str | None:
    """The UV layer of a piece that already holds the vehicle's UVs, or None."""
    paint = surface.paint[piece.span]
    found, wanted = (uvs[piece.span][paint] for uvs in (surface.soup.uvs, surface.vehicle.uvs))
    return piece.layer if np.allclose(found, wanted, atol=1e-6, equal_nan=False) else None


def _check(
    surface: Surface, pieces: list[Piece], layers: list[str | None], polygons: list[NDArray[np.bool_] | None]
) -> None:
    """Raise :class:`RaucaError` for whatever stands in the way, before anything is changed."""
    used: dict[bpy.types.Material, str] = {}
    for piece, layer, painted in zip(pieces, layers, polygons, strict=True):
        if layer is None or painted is None or piece.owner.data.library is not None:
            require_own_faces([piece])
        for worn in surface.materials(piece):
            material = require_coatable(worn, piece.owner.name)
            other = used.setdefault(material, layer or UV_LAYER)
            if other != (layer or UV_LAYER):
                raise contract.RaucaError(
                    f"{material.name}: parts that share it keep their UVs in layers {other!r} and {layer!r}; "
                    "give these layers one name"
                )


def _painted_polygons(surface: Surface, piece: Piece) -> NDArray[np.bool_] | None:
    """Painted polygons of a piece's mesh; where modifiers add faces, its marks or materials may tell them, or nothing.

    None also for what is no mesh.
    """
    mesh, paint = piece.owner.data, surface.paint[piece.span]
    if piece.owner.type != "MESH":
        return None
    if piece.direct:
        polygons = np.zeros(len(mesh.polygons), np.bool_)
        polygons[piece.polygon[paint]] = True
        return polygons
    marks = mesh.attributes.get(PAINT_MARK)
    if marks is not None and (surface.soup.marked[piece.span] == paint).all():
        return values_of(marks.data, "value", np.bool_)
    names = np.array(surface.soup.names)[surface.soup.material[piece.span]]
    painted = set(names[paint].tolist())
    if not np.array_equal(np.isin(names, list(painted)), paint):
        return None
    slots = [slot.material is not None and slot.material.name in painted for slot in piece.owner.material_slots]
    index = values_of(mesh.polygons, "material_index", np.int32)
    return np.array(slots, np.bool_)[np.minimum(index, len(slots) - 1)]
