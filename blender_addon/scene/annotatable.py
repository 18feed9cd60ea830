"""What annotation asks of a scene: other vehicles have numbers, and every surface's material can be exchanged."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import bpy
import numpy as np

from ..core import contract, semantics
from .blocks import rendered_by, values_of

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


def categories(scene: bpy.types.Scene, own: str, where: str) -> dict[int, str]:
    """COCO class of every other vehicle's id; the data set's own vehicle, of class ``own``, has no number yet.

    Raises:
        RaucaError: an object's number or category is none of another vehicle's, or two categories share a number.
    """
    carriers: dict[str, bpy.types.Object] = {}
    found: dict[int, str] = {}
    for thing, owner in _rendered_instances(scene):
        # The one that instances stands before what it brings.
        carrier = owner if semantics.INSTANCE_PROPERTY in owner else thing.original
        if semantics.INSTANCE_PROPERTY in carrier:
            carriers[carrier.name_full] = carrier
    for thing in carriers.values():
        number, category = thing[semantics.INSTANCE_PROPERTY], thing.get(semantics.CATEGORY_PROPERTY)
        # A property that Blender's panel adds is a float, and that makes 3.0 of a 3.
        whole = type(number) in (int, float) and 0 < number < semantics.TARGET_INSTANCE and number == int(number)
        named = isinstance(category, str) and category not in ("", own)
        if not whole or not named or found.get(number, category) != category:
            raise contract.RaucaError(
                f"{where}: object {thing.name}: {semantics.INSTANCE_PROPERTY} {number!r} with "
                f"{semantics.CATEGORY_PROPERTY} {category!r}; give each vehicle a whole number from 1 to 254 and one "
                f"category, not {own!r}, which is the data set's own vehicle's"
            )
        found[int(number)] = category
    return found


def require_annotatable(scene: bpy.types.Scene, own: str, where: str) -> None:
    """Raise :class:`RaucaError` naming ``where`` unless all that renders of ``scene`` show can be annotated.

    The viewport must show what renders show, as only that can be looked at. Geometry nodes may give a surface a
    material that is in no slot of its object, where no exchange reaches it.
    """
    things = shown_objects(scene)
    categories(scene, own, where)
    probe = bpy.data.materials.new("rauca probe")
    try:
        with exchanged_materials([thing for thing in things if not is_volume(thing)], lambda *_: probe):
            for thing, owner in _rendered_instances(scene):
                if _keeps_its_own(thing, probe):
                    raise contract.RaucaError(
                        f"{where}: object {owner.name}: its geometry nodes choose materials, which masks cannot tell "
                        "apart; apply its modifiers"
                    )
    finally:
        bpy.data.materials.remove(probe)


def _rendered_instances(scene: bpy.types.Scene) -> Iterator[tuple[bpy.types.Object, bpy.types.Object]]:
    """Each evaluated object that renders show, with the scene's own object that brings it, most often itself."""
    layer = scene.view_layers[0]
    layer.update()
    rendered = rendered_by(layer)
    for instance in layer.depsgraph.object_instances:
        owner = (instance.parent or instance.object).original
        left_out = owner.instance_type == "COLLECTION" and instance.is_instance and instance.object.hide_render
        if owner in rendered and not left_out:
            yield instance.object, owner


def _keeps_its_own(shown: bpy.types.Object, probe: bpy.types.Material) -> bool:
    """True when an evaluated object's faces show another material than the one that was put on everything."""
    if shown.type not in SURFACES or is_volume(shown) or (shown.type == "MESH" and not shown.data.polygons):
        return False
    materials = [slot.material for slot in shown.material_slots] or [None]
    if shown.type == "MESH":  # geometry nodes that set a material nowhere leave it a slot all the same
        chosen = values_of(shown.data.polygons, "material_index", np.int32)
        materials = [materials[i] for i in np.unique(chosen.clip(0, len(materials) - 1))]
    return any(material is None or material.original != probe for material in materials)
