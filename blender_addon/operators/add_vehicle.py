"""Add one of the vehicles that rauca brings to the open scene."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ..scene.vehicle import add_shipped, shipped_names
from .operator import RaucaOperator

SPOKEN = {"suv": "SUV", "boat_detailed": "Detailed Boat"}

_items: list[tuple[str, str, str]] = []  # Blender does not keep the strings of a list made on the fly


def _vehicles(self: bpy.types.Operator, context: bpy.types.Context | None) -> list[tuple[str, str, str]]:
    if not _items:
        names = sorted(shipped_names(), key=lambda name: (name not in ("sedan", "hatchback", "suv", "van"), name))
        _items.extend((name, SPOKEN.get(name, name.title()), "Add this vehicle to the scene") for name in names)
    return _items


class RAUCA_OT_add_vehicle(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Add a vehicle that Rauca brings, at the 3D cursor, and choose it"""

    bl_idname = "rauca.add_vehicle"
    bl_label = "Add Vehicle"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute
    vehicle: bpy.props.EnumProperty(name="Vehicle", items=_vehicles)  # type: ignore[valid-type]

    def work(self, context: bpy.types.Context) -> str:
        active = context.view_layer.objects.active
        if active is not None and active.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        thing = add_shipped(context.scene, self.vehicle)
        thing.location = context.scene.cursor.location
        context.view_layer.update()
        for other in context.view_layer.objects:
            other.select_set(other == thing)
        context.view_layer.objects.active = thing
        settings = context.scene.rauca.vehicle
        settings.origin, settings.object = "OBJECT", thing
        settings.front, settings.paint, settings.material = "AUTO", "MATERIAL", None
        return rpt("{name} added and chosen").format(name=thing.name)


CLASSES = (RAUCA_OT_add_vehicle,)
