"""The paint that step 1 tints in the viewport: which faces, when they are read again, and nothing left behind."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from blender_addon.scene.mesh_edits import mark_faces
from blender_addon.scene.vehicle import load_shipped, shipped_names
from blender_addon.steps.vehicle import paint_overlay

from .painted_box import a_box


@pytest.fixture
def vehicle(addon):
    """The step's settings, in an empty scene."""
    return addon.context.scene.rauca.vehicle


@pytest.fixture
def redraws(monkeypatch):
    """What lies on the graphics card after a redraw; without a window nothing is drawn."""

    class DrawnError(Exception):
        pass

    laid = []

    def lay_on_card(faces):
        laid.append(faces)
        return faces

    def shader(name):
        raise DrawnError

    monkeypatch.setattr(paint_overlay, "_on_card", lay_on_card)
    monkeypatch.setattr(paint_overlay.gpu, "shader", SimpleNamespace(from_builtin=shader))

    def redraw() -> int:
        """How often faces were read so far; drawing itself needs a window."""
        bpy.context.view_layer.update()
        with pytest.raises(DrawnError):
            paint_overlay._draw(bpy.context)
        return len(laid)

    redraw.laid = laid
    yield redraw
    paint_overlay._tint.unregister()


def tinted() -> dict[str, int]:
    """Tinted triangles by object."""
    bpy.context.view_layer.update()
    return {name: len(triangles) for (name, _), (_, triangles) in paint_overlay.paint_faces(bpy.context).items()}


@pytest.mark.parametrize("name", shipped_names())
def test_the_tint_is_what_a_job_takes_for_paint(vehicle, name):
    bpy.ops.rauca.add_vehicle(vehicle=name)
    shipped = load_shipped(name)
    ((vertices, triangles),) = paint_overlay.paint_faces(bpy.context).values()
    assert np.array_equal(vertices, shipped.positions)
    assert np.array_equal(triangles, shipped.triangles[shipped.paint_faces()])


def test_marks_or_a_material_say_which_faces(vehicle):
    box = a_box()
    assert tinted() == {"Box": 10}
    vehicle.material = box.data.materials[1]
    assert tinted() == {"Box": 2}
    vehicle.paint = "FACES"
    assert tinted() == {}
    mark_faces(box.data, np.arange(6) < 3)
    assert tinted() == {"Box": 6}
    box.modifiers.new("more", "SUBSURF").subdivision_type = "SIMPLE"
    assert tinted() == {"Box": 24}
    vehicle.paint, vehicle.material = "MATERIAL", None
    box.data.materials[0].name = "hull"  # nobody knows the paint any more
    assert tinted() == {}


def test_every_part_is_tinted_and_a_file_tints_nothing(vehicle):
    body, door = a_box(), a_box("Door")
    door.parent, vehicle.object = body, body
    assert tinted() == {"Box": 10, "Door": 10}
    vehicle.origin = "FILE"
    assert tinted() == {}


def test_it_is_off_until_asked_for_and_in_object_mode_only(vehicle, redraws):
    a_box()
    paint_overlay._draw(bpy.context)
    vehicle.tint = True
    assert redraws() == 1
    bpy.ops.object.mode_set(mode="EDIT")
    paint_overlay._draw(bpy.context)
    bpy.ops.object.mode_set(mode="OBJECT")
    vehicle.tint = False
    paint_overlay._draw(bpy.context)


def test_faces_are_read_again_when_they_changed_and_not_when_the_vehicle_moved(vehicle, redraws):
    box = a_box()
    vehicle.tint = True
    times = redraws()
    for move in (
        lambda: setattr(box.location, "x", 2.0), lambda: setattr(box.rotation_euler, "z", 1.0),
        lambda: box.select_set(False), lambda: setattr(vehicle, "front", "-Y"),
    ):  # fmt: skip
        move()
        assert redraws() == times
    for change in (
        lambda: box.modifiers.new("more", "SUBSURF"),
        lambda: mark_faces(box.data, np.arange(6) < 3),
        lambda: setattr(box.material_slots[1], "material", None),
        lambda: setattr(box.data.polygons[0], "material_index", 1),
        lambda: setattr(box.data.materials[0], "name", "body paint 2"),
        lambda: setattr(vehicle, "paint", "FACES"),
        lambda: bpy.context.scene.frame_set(5),
    ):
        change()
        times += 1
        assert redraws() >= times
        times = redraws()
    bpy.data.objects.remove(box)
    assert redraws() > times
    assert redraws.laid[-1] == {}


def test_nothing_enters_the_file_and_no_handler_is_left(vehicle, redraws):
    a_box()
    before = {(kind, len(getattr(bpy.data, kind))) for kind in ("objects", "meshes", "materials", "node_groups")}
    attributes = [a.name for a in bpy.data.meshes["Box"].attributes]
    vehicle.tint = True
    redraws()
    assert {(kind, len(getattr(bpy.data, kind))) for kind, _ in before} == before
    assert [a.name for a in bpy.data.meshes["Box"].attributes] == attributes
    for name, handler in paint_overlay.HANDLERS.items():
        assert getattr(bpy.app.handlers, name).count(handler) == 1
    paint_overlay.unregister()
    for name, handler in paint_overlay.HANDLERS.items():
        assert handler not in getattr(bpy.app.handlers, name)
    paint_overlay.unregister()  # disabling goes on where a handler is gone already
