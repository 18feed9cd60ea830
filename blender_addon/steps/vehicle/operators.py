"""What the buttons of step 1 do, but unwrapping."""

from __future__ import annotations

import bpy
import numpy as np
from bpy.app.translations import pgettext_rpt as rpt

from ...core import contract
from ...scene.blocks import values_of
from ...scene.mesh_edits import leave_mode, mark_faces, object_mode, require_writable, select_faces
from ...scene.paint_layer import check_paint, polygons_of
from ...scene.vehicle import add_vehicle, load_shipped, shipped_names
from ...scene.vehicle_arrays import marked_faces
from ..operator import NOT_PICKED, Obstacle, RaucaOperator

DISPLAY_NAMES = {"suv": "SUV", "boat_detailed": "Detailed Boat"}

_items: list[tuple[str, str, str]] = []  # Blender does not keep the strings of a list made on the fly


def vehicle_items(self: object = None, context: object = None) -> list[tuple[str, str, str]]:
    """Identifier, name and tooltip of every shipped vehicle, the cars first."""
    if not _items:
        names = sorted(shipped_names(), key=lambda name: (name not in ("sedan", "hatchback", "suv", "van"), name))
        _items.extend((name, DISPLAY_NAMES.get(name, name.title()), "Add this vehicle to the scene") for name in names)
    return _items


class RAUCA_OT_add_vehicle(RaucaOperator, bpy.types.Operator):
    """Add a vehicle that Rauca brings, at the 3D cursor, and choose it"""

    bl_label = "Add Vehicle"
    vehicle: bpy.props.EnumProperty(name="Vehicle", items=vehicle_items)

    def work(self, context: bpy.types.Context) -> str:
        leave_mode(context)
        thing = add_vehicle(context.scene, load_shipped(self.vehicle), context.collection)
        context.view_layer.update()
        for other in context.view_layer.objects:
            other.select_set(other == thing)
        context.view_layer.objects.active = thing
        context.scene.rauca.vehicle.choose(thing)
        return rpt("{name} added and chosen").format(name=thing.name)


ACTIONS = [
    ("ASSIGN", "Assign", "The selected faces are paint"),
    ("REMOVE", "Remove", "The selected faces are not paint"),
    ("SELECT", "Select", "Select the faces that are paint"),
]


class RAUCA_OT_mark_paint(RaucaOperator, bpy.types.Operator):
    """Say by the selected faces what is paint"""

    bl_label = "Mark Paint"
    action: bpy.props.EnumProperty(name="Action", items=ACTIONS)
    obstacles = (
        Obstacle(
            "Select the vehicle and press Tab: faces are selected in edit mode",
            lambda context: context.mode != "EDIT_MESH",
        ),
    )

    def work(self, context: bpy.types.Context) -> str:
        settings = context.scene.rauca.vehicle
        parts = settings.required_objects(context)
        edited = [thing for thing in context.objects_in_mode_unique_data if thing in parts]
        if not edited:
            raise contract.RaucaError("The object in edit mode is no part of the vehicle; pick it in step 1, Vehicle")
        if self.action == "SELECT":
            bpy.ops.object.mode_set(mode="OBJECT")
            wanted = {thing: marked_faces(thing.data) for thing in edited}
            select_faces(context, wanted)
            return rpt("{count} faces selected").format(count=sum(int(faces.sum()) for faces in wanted.values()))
        for thing in edited:
            require_writable(thing)
        with object_mode(context):
            selected = {thing: values_of(thing.data.polygons, "select", np.bool_) for thing in edited}
            if not any(chosen.any() for chosen in selected.values()):
                raise contract.RaucaError("No face is selected; select faces with 3 and a click or a box")
            for thing, chosen in selected.items():
                old = marked_faces(thing.data)
                mark_faces(thing.data, old | chosen if self.action == "ASSIGN" else old & ~chosen)
            settings.paint = "FACES"
            settings.count_marked(context)
        return rpt("{count} faces are paint").format(count=settings.marked)


KINDS = [
    ("ALL", "All", "Check the UVs and select every faulty face"),
    ("MISSING", "Missing", "Select the faces without a place in the texture"),
    ("OUTSIDE", "Outside", "Select the faces that reach beyond the texture's border"),
    ("OVERLAPPING", "Overlapping", "Select the faces that share a place in the texture with others"),
    ("UNEVEN", "Uneven", "Select the faces whose pattern would be over twice as fine or as coarse as elsewhere"),
]


class RAUCA_OT_check_uvs(RaucaOperator, bpy.types.Operator):
    """Check the UVs of the paint and select the faulty faces"""

    bl_label = "Check"
    kind: bpy.props.EnumProperty(name="Faults", items=KINDS)
    obstacles = (NOT_PICKED,)

    def work(self, context: bpy.types.Context) -> str:
        settings = context.scene.rauca.vehicle
        leave_mode(context)
        reading = settings.reading(context)
        faults = check_paint(reading)
        for name, faces in faults.items():
            setattr(settings, name, int(faces.sum()))
        settings.checked = True
        every = np.logical_or.reduce(list(faults.values()))
        shown = every if self.kind == "ALL" else faults[self.kind.lower()]
        if not shown.any():
            return "No faults found"
        select_faces(context, polygons_of(reading, shown))
        return rpt("{count} faulty triangles, selected in the viewport").format(count=int(shown.sum()))
