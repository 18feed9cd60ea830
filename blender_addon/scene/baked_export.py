"""The vehicle with its baked camouflage as a GLB, in plain materials that every viewer understands."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np

from ..core import color, contract, files
from . import nodes
from .blocks import nothing_selected, values_of
from .coating import PAINTED, Coat, take_off
from .images import blender_pixels, image_linear
from .mesh_edits import Surface
from .render import silenced


def export_glb(context: bpy.types.Context, surface: Surface, coat: Coat, layer: str, path: Path) -> None:
    """Write the vehicle with the baked image on its paint; modifiers are applied, the scene stays as it is.

    Raises:
        RaucaError: nothing is baked, or the folder cannot be written to; no file is left behind.
    """
    image = coat.image("baked")
    if image is None:
        raise contract.RaucaError("Nothing is baked yet; bake the camouflage first (step 8)")
    with (
        _as_bytes(image) as picture,
        _copies(context, surface, picture, layer),
        tempfile.TemporaryDirectory(prefix="rauca-") as folder,
    ):
        written = Path(folder) / "vehicle.glb"
        with silenced():
            bpy.ops.export_scene.gltf(
                filepath=str(written),
                export_format="GLB",
                use_selection=True,
                export_apply=True,
                export_animations=False,
                export_image_format="AUTO",
            )
        if not written.is_file():
            raise contract.RaucaError("Blender's glTF exporter wrote nothing; enable the add-on “glTF 2.0 format”")
        files.write_bytes(path, written.read_bytes())


@contextlib.contextmanager
def _as_bytes(image: bpy.types.Image) -> Iterator[bpy.types.Image]:
    """Within: an 8-bit sRGB copy of a linear float image, which glTF can hold."""
    width, height = image.size
    copy = bpy.data.images.new(image.name, width, height, alpha=False)
    try:
        copy.pixels.foreach_set(blender_pixels(color.linear_to_srgb(image_linear(image))).ravel())
        copy.pack()
        yield copy
    finally:
        bpy.data.images.remove(copy)


@contextlib.contextmanager
def _copies(context: bpy.types.Context, surface: Surface, picture: bpy.types.Image, uvs: str) -> Iterator[None]:
    """Within: the selection is a copy of the vehicle in plain materials; afterwards all is as before."""
    made: list[bpy.types.ID] = []
    materials: set[bpy.types.Material] = set()
    with nothing_selected():
        try:
            for owner in dict.fromkeys(piece.owner for piece in surface.soup.pieces):
                copy = owner.copy()
                made.append(copy)
                if owner.data is not None:  # an empty that instances a collection has none
                    copy.data = owner.data.copy()
                    made.append(copy.data)
                context.scene.collection.objects.link(copy)
                copy.matrix_world = owner.matrix_world
                copy.hide_set(False)
                if copy.type == "MESH":
                    materials |= _exchange(surface, owner, copy, picture, uvs)
                copy.select_set(True)
                context.view_layer.objects.active = copy
            yield
        finally:
            bpy.data.batch_remove([*made, *materials])


def _exchange(
    surface: Surface, owner: bpy.types.Object, copy: bpy.types.Object, picture: bpy.types.Image, layer: str
) -> set[bpy.types.Material]:
    """Give a copy plain materials: the baked image on painted faces, the rest as it was; returns the new ones."""
    mesh, specs = copy.data, _specs(surface, owner)
    painted = np.zeros(len(mesh.polygons), np.bool_)
    if mark := mesh.attributes.get(PAINTED):
        painted = values_of(mark.data, "value", np.float32) > 0.5
        mesh.attributes.remove(mark)
    made: set[bpy.types.Material] = set()
    index = values_of(mesh.polygons, "material_index", np.int32)
    for slot, worn in enumerate(owner.material_slots):
        here = painted & (index == slot)
        if here.any():
            index[here] = len(mesh.materials)
            material = _principled(specs.get((slot, True), contract.Material("paint", "paint")))
            node = nodes.texture(material.node_tree, picture, layer)
            node.extension = "REPEAT"  # the UVs may lie in several tiles
            nodes.feed(material.node_tree, nodes.principled(material.node_tree).inputs["Base Color"], node.outputs[0])
            mesh.materials.append(material)
            made.add(material)
        if worn.material is None:
            continue
        if "rauca_class" in worn.material and (slot, False) in specs:  # its color passes groups that glTF cannot follow
            material = _principled(specs[slot, False])
        else:
            material = worn.material.copy()
            take_off(material)
        made.add(material)
        copy.material_slots[slot].link = "DATA"
        mesh.materials[slot] = material
    mesh.polygons.foreach_set("material_index", index)
    mesh.update()
    return made


def _specs(surface: Surface, owner: bpy.types.Object) -> dict[tuple[int, bool], contract.Material]:
    """The contract's material of each slot of an object, on its paint (True) and off it (False)."""
    names = [slot.material.name if slot.material else "" for slot in owner.material_slots]
    found: dict[tuple[int, bool], contract.Material] = {}
    for piece in surface.soup.pieces:
        if piece.owner != owner:
            continue
        pairs = np.stack([surface.soup.material[piece.span], surface.vehicle.material[piece.span]], axis=1)
        for block, spec in np.unique(pairs, axis=0):
            name = surface.soup.names[block]
            if name in names:
                material = surface.vehicle.materials[spec]
                found[names.index(name), material.kind == "paint"] = material
    return found


def _principled(spec: contract.Material) -> bpy.types.Material:
    """A contract material without textures, as one Principled BSDF."""
    material = bpy.data.materials.new(spec.name)
    nodes.principled_surface(
        nodes.fresh_tree(material),
        Base_Color=(*spec.base_color, 1.0),
        Roughness=spec.roughness,
        Metallic=0.0 if spec.kind == "paint" else spec.metallic,
        Coat_Weight=spec.coat,
        Emission_Color=(*spec.base_color, 1.0),
        Emission_Strength=spec.emission,
    )
    return material
