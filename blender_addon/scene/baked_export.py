"""The vehicle with its baked camouflage as a GLB, in plain materials that every viewer understands."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ..core import color, contract, files
from . import nodes
from .coating import PAINTED, Coat, take_off
from .images import image_linear
from .mesh_edits import Surface
from .render import silenced
from .vehicle_arrays import values_of


def export_glb(context: bpy.types.Context, surface: Surface, coat: Coat, layer: str, path: Path) -> None:
    """Write the vehicle with the baked image on its paint; modifiers are applied, the scene stays as it is.

    Raises:
        RaucaError: nothing is baked, or the folder cannot be written to; no file is left behind.
    """
    image = coat.image("baked")
    if image is None:
        raise contract.RaucaError("Nothing is baked yet; bake the camouflage first (step 7)")
    with (
        _as_bytes(image) as picture,
        _copies(context, surface, _Plain(picture, layer)),
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
        pixels = np.ones((height, width, 4), np.float32)
        pixels[..., :3] = color.linear_to_srgb(image_linear(image)[::-1])
        copy.pixels.foreach_set(pixels.ravel())
        copy.pack()
        yield copy
    finally:
        bpy.data.images.remove(copy)


@dataclass(frozen=True, eq=False)
class _Plain:
    """The baked image and its UV layer, for plain materials."""

    image: bpy.types.Image
    layer: str

    def painted(self, spec: contract.Material) -> bpy.types.Material:
        """The baked image on the surface of a contract material."""
        material = _principled(spec)
        tree = material.node_tree
        uv = nodes.add(tree, "ShaderNodeUVMap")
        uv.uv_map = self.layer
        texture = nodes.add(tree, "ShaderNodeTexImage", Vector=uv.outputs[0])
        texture.image = self.image
        tree.links.new(texture.outputs["Color"], nodes.principled(tree).inputs["Base Color"])
        return material


@contextlib.contextmanager
def _copies(context: bpy.types.Context, surface: Surface, plain: _Plain) -> Iterator[None]:
    """Within: the selection is a copy of the vehicle in plain materials; afterwards all is as before."""
    layer = context.view_layer
    active, selected = layer.objects.active, [thing for thing in layer.objects if thing.select_get()]
    made: list[bpy.types.ID] = []
    materials: set[bpy.types.Material] = set()
    try:
        for thing in selected:
            thing.select_set(False)
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
                materials |= _exchange(surface, owner, copy, plain)
            copy.select_set(True)
            layer.objects.active = copy
        yield
    finally:
        bpy.data.batch_remove([*made, *materials])
        for thing in selected:
            thing.select_set(True)
        layer.objects.active = active


def _exchange(
    surface: Surface, owner: bpy.types.Object, copy: bpy.types.Object, plain: _Plain
) -> set[bpy.types.Material]:
    """Give a copy plain materials: the baked image on painted faces, the rest as it was; returns the new ones."""
    mesh = copy.data
    count = len(mesh.materials)
    specs = _specs(surface, owner)
    made: set[bpy.types.Material] = set()
    painted_slot: dict[int, int] = {}
    faces = len(mesh.polygons)
    painted = np.zeros(faces, np.float32)
    if mark := mesh.attributes.get(PAINTED):
        painted = values_of(mark.data, "value", (faces,), np.float32)
        mesh.attributes.remove(mark)
    index = values_of(mesh.polygons, "material_index", (faces,), np.int32)
    for slot in np.unique(index[painted > 0.5]):
        material = plain.painted(specs.get((int(slot), True), contract.Material("paint", "paint")))
        made.add(material)
        painted_slot[int(slot)] = len(mesh.materials)
        mesh.materials.append(material)
    for slot in range(count):
        own = owner.material_slots[slot].material
        if own is None:
            continue
        if "rauca_class" in own and (slot, False) in specs:  # its color passes through groups that glTF cannot follow
            material = _principled(specs[slot, False])
        else:
            material = own.copy()
            take_off(material)
        made.add(material)
        copy.material_slots[slot].link = "DATA"
        mesh.materials[slot] = material
    for slot, new in painted_slot.items():
        index[(index == slot) & (painted > 0.5)] = new
    mesh.polygons.foreach_set("material_index", index)
    mesh.update()
    return made


def _specs(surface: Surface, owner: bpy.types.Object) -> dict[tuple[int, bool], contract.Material]:
    """The contract's material of each slot of an object, on its paint (True) and off it (False)."""
    names = [slot.material.name if slot.material else "" for slot in owner.material_slots]
    found: dict[tuple[int, bool], contract.Material] = {}
    for piece, span in surface.soup.spans():
        if piece.owner != owner:
            continue
        pairs = np.stack([surface.soup.material[span], surface.vehicle.material[span]], axis=1)
        for block, spec in np.unique(pairs, axis=0):
            name = surface.soup.names[block]
            if name in names:
                material = surface.vehicle.materials[spec]
                found[names.index(name), material.kind == "paint"] = material
    return found


def _principled(spec: contract.Material) -> bpy.types.Material:
    """A contract material without textures, as one Principled BSDF."""
    material = bpy.data.materials.new(spec.name)
    tree = nodes.fresh_tree(material)
    shader = nodes.add(
        tree,
        "ShaderNodeBsdfPrincipled",
        Base_Color=(*spec.base_color, 1.0),
        Roughness=spec.roughness,
        Metallic=0.0 if spec.kind == "paint" else spec.metallic,
        Coat_Weight=spec.coat,
        Emission_Color=(*spec.base_color, 1.0),
        Emission_Strength=spec.emission,
    )
    nodes.output(tree, Surface=shader.outputs[0])
    return material
