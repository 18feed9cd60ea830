"""What annotation asks of a scene: other vehicles have numbers, and every surface's material can be exchanged."""

from __future__ import annotations

import bpy

from ..core import contract, semantics
from .exchange import SURFACES, exchanged_materials, is_volume, shown_objects


def categories(things: list[bpy.types.Object], own: str, where: str) -> dict[int, str]:
    """COCO class of every other vehicle's id; the data set's own vehicle, of class ``own``, has no number yet.

    Raises:
        RaucaError: an object's number or category is none of another vehicle's, or two categories share a number.
    """
    found: dict[int, str] = {}
    for thing in things:
        number, category = thing.get(semantics.INSTANCE_PROPERTY), thing.get(semantics.CATEGORY_PROPERTY)
        if number is None:
            continue
        whole = type(number) is int and 0 < number < semantics.TARGET_INSTANCE
        named = isinstance(category, str) and category not in ("", own)
        if not whole or not named or found.get(number, category) != category:
            raise contract.RaucaError(
                f"{where}: object {thing.name}: {semantics.INSTANCE_PROPERTY} {number!r} with "
                f"{semantics.CATEGORY_PROPERTY} {category!r}; give each vehicle a whole number from 1 to 254 and one "
                f"category, not {own!r}, which is the data set's own vehicle's"
            )
        found[number] = category
    return found


def require_annotatable(scene: bpy.types.Scene, own: str, where: str) -> None:
    """Raise :class:`RaucaError` naming ``where`` unless all that ``scene`` shows can be annotated.

    Geometry nodes may give a surface a material that is in no slot of its object, where no exchange reaches it.
    """
    things = shown_objects(scene)
    categories(things, own, where)
    probe = bpy.data.materials.new("rauca probe")
    try:
        with exchanged_materials([thing for thing in things if not is_volume(thing)], lambda *_: probe):
            layer = scene.view_layers[0]
            layer.update()
            for instance in layer.depsgraph.object_instances:
                if _keeps_its_own(instance.object, probe):
                    owner = instance.parent or instance.object
                    raise contract.RaucaError(
                        f"{where}: object {owner.name}: its geometry nodes choose materials, which masks cannot tell "
                        "apart; apply its modifiers"
                    )
    finally:
        bpy.data.materials.remove(probe)


def _keeps_its_own(shown: bpy.types.Object, probe: bpy.types.Material) -> bool:
    """True when an evaluated object shows another material than the one that was put on everything."""
    if shown.type not in SURFACES or is_volume(shown) or (shown.type == "MESH" and not shown.data.polygons):
        return False
    materials = [slot.material for slot in shown.material_slots] or [None]
    return any(material is None or material.original != probe for material in materials)
