"""Step 1 as an artist uses it: objects of the open scene become the vehicle, paint is marked, UVs made and checked."""

from __future__ import annotations

import re

import bpy
import numpy as np
import pytest

from blender_addon.scene.mesh_edits import mark_faces
from blender_addon.scene.paint_layer import to_unwrap, write_unwrapped
from blender_addon.scene.vehicle import load_shipped
from blender_addon.scene.vehicle_files import import_vehicle
from blender_addon.steps.vehicle.panel import state
from blender_addon.steps.vehicle.unwrap import UnwrapChild
from rauca_core.geometry import repack
from tests.atlas_report import atlas_report

from .conftest import refusal
from .painted_box import a_box
from .timer import until


@pytest.fixture
def vehicle(addon):
    """The step's settings, in an empty scene."""
    return addon.context.scene.rauca.vehicle


def undoable(operator, **options):
    """Run an operator as its button does, with a step of undo; names are looked up anew, as undo replaces the data."""
    return operator("EXEC_DEFAULT", True, **options)


def select(box, wanted) -> None:
    """Edit mode with these polygons selected."""
    bpy.context.view_layer.objects.active = box
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_mode(type="FACE")
    bpy.ops.mesh.select_all(action="DESELECT")
    bpy.ops.object.mode_set(mode="OBJECT")
    for polygon in box.data.polygons:
        polygon.select = wanted(polygon)
    bpy.ops.object.mode_set(mode="EDIT")


def uv_layers(name) -> list[str]:
    return [layer.name for layer in bpy.data.objects[name].data.uv_layers]


# --- choosing


def test_nothing_picked_says_what_to_do(vehicle):
    assert state(bpy.context).kind == "missing"
    assert "No vehicle: in step 1, Vehicle, pick an object" in refusal(vehicle.chosen, bpy.context)
    assert not bpy.ops.rauca.unwrap_paint.poll()
    assert not bpy.ops.rauca.check_uvs.poll()
    vehicle.origin = "COLLECTION"
    assert "choose a collection that has objects" in refusal(vehicle.chosen, bpy.context)
    vehicle.origin, vehicle.file = "FILE", ""
    assert "choose a file" in refusal(vehicle.chosen, bpy.context)


def test_every_shipped_vehicle_can_be_added_comes_out_as_itself_and_can_be_undone(vehicle):
    bpy.context.scene.cursor.location = (5.0, -3.0, 0.5)
    bpy.ops.ed.undo_push(message="start")
    for name in ("sedan", "van", "cube"):
        assert undoable(bpy.ops.rauca.add_vehicle, vehicle=name) == {"FINISHED"}
        shipped = load_shipped(name)
        chosen = bpy.context.scene.rauca.vehicle.chosen(bpy.context)
        assert (chosen.name, chosen.atlas_id, chosen.geometry_id) == (name, shipped.atlas_id, shipped.geometry_id)
        assert state(bpy.context).kind == "done"
    assert tuple(bpy.context.object.location) == (5.0, -3.0, 0.5)
    assert bpy.context.scene.rauca.vehicle.object.name == "cube"
    bpy.ops.ed.undo()
    assert "cube" not in bpy.data.objects
    assert bpy.context.scene.rauca.vehicle.object.name == "van"


def test_a_vehicle_goes_to_the_active_collection(vehicle):
    own = bpy.data.collections.new("Cars")
    bpy.context.scene.collection.children.link(own)
    bpy.context.view_layer.active_layer_collection = bpy.context.view_layer.layer_collection.children["Cars"]
    bpy.ops.rauca.add_vehicle(vehicle="cube")
    assert [found.name for found in bpy.context.object.users_collection] == ["Cars"]


def test_a_tick_is_given_for_what_was_checked(vehicle):
    box = a_box()
    assert state(bpy.context).kind == "ready"  # nobody has looked at its UVs yet
    bpy.ops.rauca.check_uvs()
    assert state(bpy.context).kind == "done"
    for loop in box.data.uv_layers[0].uv:
        loop.vector = loop.vector * 3.0
    bpy.ops.rauca.check_uvs()
    assert state(bpy.context).kind == "missing"
    assert "triangles are faulty; unwrap the paint" in state(bpy.context).words


def test_a_vehicle_whose_paint_nobody_knows_is_not_ticked(vehicle):
    box = a_box(material="hull")
    assert state(bpy.context).words == "Which material of Box is paint? Choose it under Paint"
    vehicle.material = box.data.materials[0]
    assert state(bpy.context).words == "Box is the vehicle"
    vehicle.material, vehicle.paint = None, "FACES"
    assert "mark them" in state(bpy.context).words


def test_a_shipped_vehicle_that_was_edited_is_no_longer_the_shipped_one(vehicle):
    bpy.ops.rauca.add_vehicle(vehicle="cube")
    bpy.context.object.data.vertices[0].co.z += 0.25
    vehicle.material = bpy.context.object.material_slots[0].material
    assert vehicle.chosen(bpy.context).geometry_id != load_shipped("cube").geometry_id


def test_a_deleted_object_is_no_vehicle(vehicle):
    box = a_box()
    bpy.context.scene.collection.objects.unlink(box)
    assert "no longer in this scene" in state(bpy.context).words
    assert "pick an object of this scene" in refusal(vehicle.chosen, bpy.context)


# --- the same as the headless import


def parts_with_everything() -> None:
    """A body with modifiers, UV layers and a turned, mirrored, linked-data pair of wings: children of an empty."""
    root = bpy.data.objects.new("Car", None)
    bpy.context.scene.collection.objects.link(root)
    body = a_box("Body")
    body.modifiers.new("Smooth", "SUBSURF").levels = 1
    body.data.uv_layers.new(name="Second")
    left = a_box("Left wing", "trim", size=(1.0, 0.2, 0.4), location=(1.0, 1.2, 0.0))
    right = left.copy()
    right.name, right.location.y, right.scale.y = "Right wing", -1.2, -0.2
    bpy.context.scene.collection.objects.link(right)
    for part in (body, left, right):
        part.parent = root
    bpy.context.scene.rauca.vehicle.object = root


@pytest.mark.parametrize("marked", [False, True])
def test_a_scene_object_is_what_the_headless_import_makes_of_it(vehicle, tmp_path, marked):
    parts_with_everything()
    if marked:
        mark_faces(bpy.data.objects["Body"].data, np.arange(6) < 2)
        vehicle.paint = "FACES"
    here = vehicle.chosen(bpy.context)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "car.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    there = import_vehicle(tmp_path / "car.blend")
    assert here.geometry_id == there.geometry_id
    assert here.materials == there.materials
    assert here.notes == there.notes
    for name in ("positions", "triangles", "uvs", "normals", "material", "paint_mask"):
        assert np.array_equal(getattr(here, name), getattr(there, name)), name
    folder = tmp_path / "saved"
    here.save(folder)
    assert import_vehicle(folder).geometry_id == here.geometry_id


@pytest.mark.parametrize(
    ("hide", "faces"),
    [
        (lambda thing, parts, layer: thing.hide_set(True), 24),
        (lambda thing, parts, layer: setattr(thing, "hide_viewport", True), 24),
        (lambda thing, parts, layer: setattr(thing, "hide_render", True), 12),
        (lambda thing, parts, layer: setattr(layer, "hide_viewport", True), 24),
        (lambda thing, parts, layer: setattr(parts, "hide_viewport", True), 24),
        (lambda thing, parts, layer: setattr(parts, "hide_render", True), 12),
        (lambda thing, parts, layer: setattr(layer, "exclude", True), 12),
    ],
)
def test_what_renders_show_is_the_vehicle_whatever_the_viewport_hides(vehicle, tmp_path, hide, faces):
    body, wheels = a_box("Body"), a_box("Wheels", "tyre", size=(3.0, 2.2, 0.5))
    parts = bpy.data.collections.new("Parts")
    bpy.context.scene.collection.children.link(parts)
    bpy.context.scene.collection.objects.unlink(wheels)
    parts.objects.link(wheels)
    wheels.parent, vehicle.object = body, body
    hide(wheels, parts, bpy.context.view_layer.layer_collection.children["Parts"])
    hidden = wheels.hide_get(), wheels.hide_viewport, parts.hide_viewport, wheels.visible_get()
    assert len(vehicle.chosen(bpy.context).triangles) == faces
    assert (wheels.hide_get(), wheels.hide_viewport, parts.hide_viewport, wheels.visible_get()) == hidden
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "car.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert len(import_vehicle(tmp_path / "car.blend").triangles) == faces
    assert len(bpy.data.scenes) == 1


def test_a_collection_is_the_object_with_its_children(vehicle):
    parts_with_everything()
    one = vehicle.chosen(bpy.context)
    parts = bpy.data.collections.new("Parts")
    for thing in vehicle.objects(bpy.context):
        parts.objects.link(thing)
    vehicle.origin, vehicle.collection = "COLLECTION", parts
    two = vehicle.chosen(bpy.context)
    assert (two.name, two.geometry_id) == ("Parts", one.geometry_id)


@pytest.mark.parametrize(("front", "corner"), [("+X", (2, 1)), ("-X", (-2, -1)), ("+Y", (1, -2)), ("-Y", (-1, 2))])
def test_the_front_is_where_the_artist_says(vehicle, front, corner):
    box = a_box(size=(4.0, 2.0, 1.5))
    nose = max(box.data.vertices, key=lambda vertex: (vertex.co.x, vertex.co.y, vertex.co.z)).index
    vehicle.front = front
    assert np.allclose(vehicle.chosen(bpy.context).positions[nose][:2], corner, atol=1e-5)


def test_two_uv_layers_the_one_that_renders_show_is_taken_and_told(vehicle):
    box = a_box()
    shown = box.data.uv_layers.new(name="Shown")
    shown.active_render = True
    values = np.random.default_rng(0).random(len(box.data.loops) * 2).astype(np.float32)
    shown.uv.foreach_set("vector", values)
    reading = vehicle.reading(bpy.context)
    assert "UVs: layer 'Shown', of several" in reading.notes
    assert np.isin(reading.soup.uvs, values).all()


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda box: box.data.materials.pop(index=0), "cannot tell which faces are paint.*mark its faces"),
        (lambda box: setattr(box, "hide_render", True), "has no faces that renders show"),
        (lambda box: setattr(box, "scale", (900, 400, 300)), "Box: is 900 long, metres are expected"),
    ],
)
def test_an_object_that_cannot_be_the_vehicle_is_refused_in_one_line(vehicle, make, expected):
    make(a_box())
    bpy.context.view_layer.update()
    assert re.search(expected, refusal(vehicle.chosen, bpy.context))


# --- paint by faces


def test_faces_are_marked_unmarked_selected_and_undone(vehicle):
    box = a_box()
    assert not bpy.ops.rauca.mark_paint.poll()
    select(box, lambda polygon: polygon.index < 3)
    bpy.ops.ed.undo_push(message="selected")
    assert undoable(bpy.ops.rauca.mark_paint, action="ASSIGN") == {"FINISHED"}
    settings = bpy.context.scene.rauca.vehicle
    assert (settings.paint, settings.marked, bpy.context.mode) == ("FACES", 3, "EDIT_MESH")
    assert state(bpy.context).words == "Box, 3 faces are paint"
    assert settings.chosen(bpy.context).paint_faces().sum() == 6
    assert bpy.context.mode == "EDIT_MESH"
    select(bpy.data.objects["Box"], lambda polygon: polygon.index == 0)
    undoable(bpy.ops.rauca.mark_paint, action="REMOVE")
    assert bpy.context.scene.rauca.vehicle.marked == 2
    undoable(bpy.ops.rauca.mark_paint, action="SELECT")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert [p.index for p in bpy.data.objects["Box"].data.polygons if p.select] == [1, 2]
    numbers = []
    for _ in range(6):
        numbers.append(bpy.context.scene.rauca.vehicle.marked)
        bpy.ops.ed.undo()
    assert numbers == [2, 2, 3, 0, 0, 0]


def test_marking_says_what_is_wrong(vehicle):
    box = a_box()
    select(box, lambda polygon: False)
    assert "No face is selected" in refusal(bpy.ops.rauca.mark_paint, action="ASSIGN")
    vehicle.object = None
    assert "pick an object" in refusal(bpy.ops.rauca.mark_paint, action="ASSIGN")
    bpy.ops.object.mode_set(mode="OBJECT")
    vehicle.object, vehicle.paint = box, "FACES"
    assert "no face is marked as paint" in refusal(vehicle.chosen, bpy.context)


# --- UVs


def test_unwrapping_makes_a_clean_layer_beside_the_others(vehicle):
    a_box()
    bpy.ops.ed.undo_push(message="start")
    assert undoable(bpy.ops.rauca.unwrap_paint) == {"FINISHED"}
    assert uv_layers("Box") == ["UVMap", "rauca"]
    assert bpy.data.objects["Box"].data.uv_layers["UVMap"].active_render
    chosen = bpy.context.scene.rauca.vehicle.chosen(bpy.context)
    report = atlas_report(chosen)
    assert (report.overlap, report.out_of_range, report.degenerate) == (0, 0, 0)
    assert report.worst_spread < 0.01
    assert report.density_of_charts < 0.01
    assert bpy.context.scene.rauca.vehicle.chosen(bpy.context).atlas_id == chosen.atlas_id
    bpy.ops.ed.undo()
    assert uv_layers("Box") == ["UVMap"]


def test_no_polygon_is_torn_by_the_cuts_of_the_atlas(vehicle):
    """Every quad is cut along its diagonal by an atlas that lays each triangle apart: each comes out whole."""
    a_box()
    bare = to_unwrap(vehicle.reading(bpy.context))
    apart = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]) + 2.0 * np.arange(10)[:, None, None] * [1.0, 0.0]
    assert write_unwrapped(vehicle.reading(bpy.context), repack(bare, apart)) == 5
    report = atlas_report(vehicle.chosen(bpy.context))
    assert (report.charts, report.overlap, report.out_of_range, report.degenerate) == (5, 0, 0, 0)
    assert report.worst_spread < 1e-3


def test_the_child_process_unwraps_as_the_window_asks(vehicle):
    box = a_box()
    child = UnwrapChild(to_unwrap(vehicle.reading(bpy.context)))
    try:
        until(lambda: not child.is_alive(), 60)
        fresh = child.result()
    finally:
        child.stop()
    assert not child.folder.exists()
    box.data.vertices[0].co.x += 0.1
    assert "changed while it was unwrapped" in refusal(write_unwrapped, vehicle.reading(bpy.context), fresh)
    assert uv_layers("Box") == ["UVMap"]
    box.data.vertices[0].co.x = -0.5
    assert write_unwrapped(vehicle.reading(bpy.context), fresh) == 5


def linked(box):
    """The box's mesh comes from another file."""
    bpy.data.libraries.write(bpy.app.tempdir + "lib.blend", {box.data})
    name = box.data.name
    with bpy.data.libraries.load(bpy.app.tempdir + "lib.blend", link=True) as (_, wanted):
        wanted.meshes = [name]
    box.data = wanted.meshes[0]


def shared(box):
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Twin", box.data))


def full(box):
    for number in range(7):
        box.data.uv_layers.new(name=f"More {number}")


def instanced(box):
    parts = bpy.data.collections.new("Parts")
    parts.objects.link(box)
    bpy.context.scene.collection.objects.unlink(box)
    shown = bpy.data.objects.new("Instance", None)
    shown.instance_type, shown.instance_collection = "COLLECTION", parts
    bpy.context.scene.collection.objects.link(shown)
    bpy.context.scene.rauca.vehicle.object = shown


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda box: box.modifiers.new("Mirror", "MIRROR"), r"Box: its modifiers \(Mirror\) change its faces.*Convert"),
        (shared, "Box: other objects share its mesh.*Make Single User"),
        (linked, "Box: is linked from .*lib.blend.*Make Local"),
        (instanced, "Instance: its faces are instances.*Make Instances Real"),
        (full, "has 8 UV layers"),
        (lambda box: bpy.ops.rauca.add_vehicle(vehicle="cube"), "cube: has the UV map that its camouflages fit"),
    ],
)
def test_a_mesh_that_cannot_be_written_to_is_read_but_not_unwrapped(vehicle, make, expected):
    make(a_box())
    bpy.context.view_layer.update()
    assert vehicle.chosen(bpy.context).paint_faces().any()
    assert re.search(expected, refusal(bpy.ops.rauca.unwrap_paint))


def test_the_check_finds_each_fault_and_selects_its_faces(vehicle):
    box = a_box(size=(4.0, 2.0, 1.5))
    bpy.ops.rauca.unwrap_paint()
    bpy.ops.rauca.check_uvs()
    found = {name: getattr(vehicle, name) for name in ("missing", "outside", "overlapping", "uneven")}
    assert vehicle.checked
    assert not any(found.values())
    painted = [p for p in box.data.polygons if p.material_index == 0]
    uv = box.data.uv_layers["rauca"].uv

    def move(polygon, how):
        for loop in polygon.loop_indices:
            uv[loop].vector = how(np.array(uv[loop].vector), loop)

    index = [p.index for p in painted]  # Blender moves the polygons themselves when modes change
    middle = {p.index: np.mean([uv[i].vector for i in p.loop_indices], axis=0) for p in painted}
    move(painted[0], lambda at, loop: at * 0)  # a point
    move(painted[1], lambda at, loop: at + np.array([5.5, 0.0]))  # half across the border of a tile far away
    move(painted[2], lambda at, loop: (at - middle[painted[2].index]) * 0.3 + middle[painted[2].index])  # too coarse
    source = painted[3].loop_indices
    move(painted[4], lambda at, loop: np.array(uv[source[loop - painted[4].loop_indices[0]]].vector))  # on another
    expected = {"MISSING": {0}, "UNEVEN": {2}, "OVERLAPPING": {3, 4}}
    for kind, numbers in expected.items():
        assert bpy.ops.rauca.check_uvs(kind=kind) == {"FINISHED"}
        assert bpy.context.mode == "EDIT_MESH"
        bpy.ops.object.mode_set(mode="OBJECT")
        selected = {p.index for p in bpy.context.object.data.polygons if p.select}
        assert {index[n] for n in numbers} <= selected, kind
    assert (vehicle.missing, vehicle.outside) == (2, 2)
    bpy.ops.rauca.check_uvs()
    bpy.ops.object.mode_set(mode="OBJECT")
    every = {p.index for p in bpy.context.object.data.polygons if p.select}
    assert every == set(index)
    vehicle.front = "+X"
    assert not vehicle.checked


def test_faults_behind_modifiers_are_counted_but_cannot_be_selected(vehicle):
    box = a_box()
    box.modifiers.new("Mirror", "MIRROR").use_axis = (False, True, False)
    box.data.uv_layers[0].uv.foreach_set("vector", np.full(2 * len(box.data.loops), 0.5, np.float32))
    assert "Convert > Mesh applies them" in refusal(bpy.ops.rauca.check_uvs)
    assert vehicle.checked
    assert vehicle.missing > 0
