"""Every surface in other materials for a while."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import bpy

SURFACES = ("MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD")

Choice = Callable[[bpy.types.Object, bpy.types.Material | None], bpy.types.Material]


def shown_objects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The objects that a render shows, those inside instanced collections included."""
    layer = scene.view_layers[0]
    layer.update()
    found = {
        instance.object.original.name_full: instance.object.original for instance in layer.depsgraph.object_instances
    }
    found |= {thing.name_full: thing for thing in scene.objects}
    return list(found.values())


def is_volume(thing: bpy.types.Object) -> bool:
    """True when an object is a volume's container only: its materials have no surface."""
    materials = [slot.material for slot in thing.material_slots if slot.material]
    return thing.type in SURFACES and bool(materials) and all(_only_volume(material) for material in materials)


@contextlib.contextmanager
def exchanged_materials(things: list[bpy.types.Object], choose: Choice) -> Iterator[None]:
    """Within: each surface of ``things`` has the material that ``choose(object, its material)`` gives it.

    Surfaces without a material get one too, so that none is left to the renderer's default.
    """
    surfaces = [thing for thing in things if thing.type in SURFACES]
    bare = [thing.data for thing in surfaces if not thing.material_slots]
    for data in set(bare):
        data.materials.append(None)
    slots = [(thing, slot, slot.material) for thing in surfaces for slot in thing.material_slots]
    try:
        for thing, slot, material in slots:
            slot.material = choose(thing, material)
        yield
    finally:
        for _, slot, material in slots:
            slot.material = material
        for data in set(bare):
            data.materials.clear()  # pop would leave the objects their slot


def _only_volume(material: bpy.types.Material) -> bool:
    output = material.node_tree.get_output_node("CYCLES") if material.node_tree else None
    return output is not None and output.inputs["Volume"].is_linked and not output.inputs["Surface"].is_linked
