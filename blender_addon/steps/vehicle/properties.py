"""The choice of a vehicle, kept in the scene."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...core import contract
from ...scene.mesh_edits import marked_count, object_mode
from ...scene.vehicle import CLASS_KEY, NAME_KEY, shipped_names
from ...scene.vehicle_files import find_vehicle
from ...scene.vehicle_paint import choose_paint
from ...scene.vehicle_reading import Reading, read_vehicle
from ...scene.vehicle_request import VehicleRequest
from ...translations import OWN_SENSE

SHAPES = ("MESH", "CURVE", "SURFACE", "META", "FONT", "EMPTY")  # objects that a vehicle can be made of


def _shaped(self: bpy.types.PropertyGroup, thing: bpy.types.Object) -> bool:
    return thing.type in SHAPES and thing.name in bpy.context.scene.objects


def _changed(self: RaucaVehicle, context: bpy.types.Context) -> None:
    """Another vehicle or other paint: what was found out about the last one no longer holds."""
    self.checked = False
    self.count_marked(context)


class RaucaVehicle(bpy.types.PropertyGroup):
    """The vehicle that the other steps work on, and what is paint on it."""

    origin: bpy.props.EnumProperty(
        name="From",
        items=[
            ("OBJECT", "Object", "An object of this scene, with its children"),
            ("COLLECTION", "Collection", "All objects of a collection"),
            ("FILE", "File", "A vehicle's file or folder; the scene is left alone"),
        ],
        description="Where the vehicle comes from",
        update=_changed,
    )
    object: bpy.props.PointerProperty(
        name="Object",
        type=bpy.types.Object,
        poll=_shaped,
        update=_changed,
        description="The vehicle, or the parent of its parts",
    )
    collection: bpy.props.PointerProperty(
        name="Collection", type=bpy.types.Collection, update=_changed, description="The collection of the parts"
    )
    file: bpy.props.StringProperty(
        name="File",
        default="sedan",
        subtype="FILE_PATH",
        update=_changed,
        description="An .obj, .glb, .gltf or .blend file, a saved vehicle's folder, or the name of one of Rauca's own",
    )
    front: bpy.props.EnumProperty(
        name="Front",
        items=[
            ("AUTO", "Longer Side", "Along x if the vehicle is longer there, else towards -y"),
            ("+X", "+X", "The vehicle looks along x"),
            ("-X", "-X", "The vehicle looks against x"),
            ("+Y", "+Y", "The vehicle looks along y"),
            ("-Y", "-Y", "The vehicle looks against y, as Blender's front view shows it"),
        ],
        description="Where the vehicle's front points in the scene; up is always z",
        update=_changed,
    )
    paint: bpy.props.EnumProperty(
        name="Paint",
        items=[
            ("MATERIAL", "Material", "Paint is where one material is"),
            ("FACES", "Faces", "Paint is where faces are marked"),
        ],
        description="How the faces that may be camouflaged are told from the rest",
        update=_changed,
    )
    material: bpy.props.PointerProperty(
        name="Material",
        type=bpy.types.Material,
        update=_changed,
        description="The paint's material; empty: the one whose name says paint, body or car",
    )
    file_material: bpy.props.StringProperty(
        name="Material", description="The paint's material in the file; empty: the one whose name says so"
    )
    file_mask: bpy.props.StringProperty(
        name="Paint Mask",
        translation_context=OWN_SENSE,
        subtype="FILE_PATH",
        description="A grey image, white where the camouflage may go",
    )
    tint: bpy.props.BoolProperty(
        name="Show Paint", description="Tint the faces that are paint in the viewport, in object mode"
    )
    marked: bpy.props.IntProperty(options={"HIDDEN"})
    checked: bpy.props.BoolProperty(options={"HIDDEN"})
    missing: bpy.props.IntProperty(options={"HIDDEN"})
    outside: bpy.props.IntProperty(options={"HIDDEN"})
    overlapping: bpy.props.IntProperty(options={"HIDDEN"})
    uneven: bpy.props.IntProperty(options={"HIDDEN"})

    def chosen(self, context: bpy.types.Context) -> contract.Vehicle:
        """The vehicle as every job and every other step uses it: what the headless import makes of the same objects.

        Reads every mesh: for operators, not for drawing.

        Raises:
            RaucaError: none is chosen, or it cannot be used; says what to do.
        """
        with object_mode(context):
            if self.origin == "FILE":
                return self._from_file()
            return read_vehicle(self.required_objects(context), self.request())

    def reading(self, context: bpy.types.Context) -> Reading:
        """The chosen objects face by face; in object mode. Raises as :meth:`chosen`."""
        return Reading.of(self.required_objects(context), self.request())

    def picked(self, context: bpy.types.Context) -> bpy.types.ID | None:
        """The object or collection that is picked and still there; quick enough for drawing."""
        if self.origin == "OBJECT" and self.object is not None and self.object.name in context.scene.objects:
            return self.object
        return self.collection if self.origin == "COLLECTION" else None

    def objects(self, context: bpy.types.Context) -> list[bpy.types.Object]:
        """The objects of the scene that make up the vehicle; none for a file, or while nothing is picked."""
        root = self.picked(context)
        if root is None:
            return []
        shown = set(context.scene.objects)
        parts = root.all_objects if self.origin == "COLLECTION" else [root, *root.children_recursive]
        return [thing for thing in parts if thing in shown]

    def required_objects(self, context: bpy.types.Context) -> list[bpy.types.Object]:
        """The objects, at least one; raises :class:`RaucaError` without any."""
        objects = self.objects(context)
        if objects:
            return objects
        if self.origin == "COLLECTION":
            raise contract.RaucaError("No vehicle: in step 1, Vehicle, choose a collection that has objects")
        raise contract.RaucaError("No vehicle: in step 1, Vehicle, pick an object of this scene or add a vehicle")

    def request(self) -> VehicleRequest:
        """How the chosen objects become a vehicle."""
        root = self.collection if self.origin == "COLLECTION" else self.object
        name, by_marks = root.name if root is not None else "", self.paint == "FACES"
        material = self.material.name if self.material is not None and not by_marks else None
        return VehicleRequest(name, front=self.front, paint_material=material, by_marks=by_marks)

    def is_shipped(self, context: bpy.types.Context) -> bool:
        """Whether the picked object was made from one of Rauca's own vehicles."""
        return self.origin == "OBJECT" and self.object is not None and NAME_KEY in self.object

    def knows_paint(self, context: bpy.types.Context) -> bool:
        """Whether the paint's material is chosen or told by its name; asks slots alone, for drawing."""
        if self.is_shipped(context):
            return True
        try:
            self.paint_materials(context)
        except contract.RaucaError:
            return False
        return True

    def paint_materials(self, context: bpy.types.Context) -> list[str]:
        """Names of the materials that are paint, of slots alone; raises :class:`RaucaError` where nothing tells."""
        parts = [thing for thing in self.objects(context) if thing.type == "MESH"]
        slots = [slot.material for thing in parts for slot in thing.material_slots]
        if any(len(thing.material_slots) == 0 for thing in parts):
            slots.append(None)
        request = self.request()
        if self.is_shipped(context) and not request.own_paint:
            return [material.name for material in slots if material is not None and material.get(CLASS_KEY) == "paint"]
        names = dict.fromkeys(material.name if material is not None else "" for material in slots)
        return list(choose_paint(list(names), request))

    def choose(self, shipped: bpy.types.Object) -> None:
        """Choose an object that is one of Rauca's own vehicles."""
        self.origin, self.object = "OBJECT", shipped
        self.front, self.paint, self.material = "AUTO", "MATERIAL", None

    def count_marked(self, context: bpy.types.Context) -> None:
        """Count the marked faces for the panel, which must not read meshes."""
        self.marked = sum(marked_count(thing) for thing in self.objects(context) if thing.type == "MESH")

    def _from_file(self) -> contract.Vehicle:
        if not self.file:
            raise contract.RaucaError("No vehicle: in step 1, Vehicle, choose a file")
        if self.file in shipped_names():
            return find_vehicle(contract.VehicleSource(self.file))
        mask = Path(bpy.path.abspath(self.file_mask)) if self.file_mask else None
        return find_vehicle(contract.VehicleSource(bpy.path.abspath(self.file), mask, self.file_material or None))


@bpy.app.handlers.persistent
def _recount(*given: object) -> None:
    """An undo in edit mode takes back the marks on the faces, but not their number in the settings."""
    bpy.context.scene.rauca.vehicle.count_marked(bpy.context)


def register() -> None:
    for handlers in (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post):
        handlers.append(_recount)


def unregister() -> None:
    for handlers in (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post):
        if _recount in handlers:
            handlers.remove(_recount)
