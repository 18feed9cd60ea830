"""The paint that step 1 tints in the viewport: which faces, when they are read again, and nothing left behind."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from blender_addon.scene.mesh_edits import mark_faces
from blender_addon.scene.vehicle import load_shipped, shipped_names
from blender_addon.steps.vehicle import paint_overlay

from .painted_box import a_box


@pytest.fixture
def vehicle(addon):
    """The step's settings, in an empty scene."""
    return addon.context.scene.rauca.vehicle


class Card:
    """Stands for the graphics card, which a Blender without a window has not: notes what is drawn, and where."""

    def __init__(self) -> None:
        self.laid: list[dict] = []  # the faces of each object, at every reading
        self.drawn: list[tuple[str, tuple[float, ...]]] = []  # object and place, of the last redraw
        self.place = None

    def lay(self, faces):
        self.laid.append(faces)
        return {name: SimpleNamespace(draw=lambda shader, name=name: self.note(name[0])) for name in faces}

    def note(self, name: str) -> None:
        self.drawn.append((name, tuple(self.place.translation)))

    def redraw(self) -> int:
        """How often faces were read so far."""
        bpy.context.view_layer.update()
        self.drawn.clear()
        area = SimpleNamespace(scene=bpy.context.scene, mode=bpy.context.mode, view_layer=bpy.context.view_layer)
        paint_overlay._draw(SimpleNamespace(**vars(area), space_data=None))
        return len(self.laid)


@pytest.fixture
def card(monkeypatch):
    found = Card()
    shader = SimpleNamespace(bind=lambda: None, uniform_float=lambda *given: None)
    settings = dict.fromkeys(("blend_set", "depth_test_set", "depth_mask_set"), lambda value: None)
    matrix = SimpleNamespace(
        get_projection_matrix=lambda: Matrix.Identity(4),
        load_projection_matrix=lambda matrix: None,
        push_pop_projection=nullcontext,
        push_pop=nullcontext,
        multiply_matrix=lambda matrix: setattr(found, "place", matrix.copy()),
    )
    shaders = SimpleNamespace(from_builtin=lambda name: shader)
    fake = SimpleNamespace(shader=shaders, state=SimpleNamespace(**settings), matrix=matrix)
    monkeypatch.setattr(paint_overlay, "gpu", fake)
    monkeypatch.setattr(paint_overlay, "_on_card", found.lay)
    yield found
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


def test_it_is_off_until_asked_for_and_in_object_mode_only(vehicle, card):
    a_box()
    assert (card.redraw(), card.drawn) == (0, [])
    vehicle.tint = True
    assert card.redraw() == 1
    assert [name for name, _ in card.drawn] == ["Box"]
    bpy.ops.object.mode_set(mode="EDIT")
    card.redraw()
    assert card.drawn == []
    bpy.ops.object.mode_set(mode="OBJECT")
    vehicle.tint = False
    card.redraw()
    assert card.drawn == []


def test_it_follows_the_vehicle_and_hides_with_it(vehicle, card):
    box = a_box()
    vehicle.tint = True
    card.redraw()
    box.location = (2.0, -1.0, 0.5)
    card.redraw()
    assert card.drawn == [("Box", (2.0, -1.0, 0.5))]
    box.hide_set(True)
    card.redraw()
    assert card.drawn == []


def test_faces_are_read_again_when_they_changed_and_not_when_the_vehicle_moved(vehicle, card):
    box, other = a_box(), a_box("Other")
    vehicle.object, vehicle.tint = box, True
    times = card.redraw()
    for move in (
        lambda: setattr(box.location, "x", 2.0), lambda: setattr(box.rotation_euler, "z", 1.0),
        lambda: box.select_set(False), lambda: setattr(vehicle, "front", "-Y"),
        lambda: other.modifiers.new("more", "SUBSURF"),
    ):  # fmt: skip
        move()
        assert card.redraw() == times
    for change in (
        lambda: box.modifiers.new("more", "SUBSURF"),
        lambda: mark_faces(box.data, np.arange(6) < 3),
        lambda: setattr(box.material_slots[1], "material", None),
        lambda: setattr(box.data.polygons[0], "material_index", 1),
        lambda: setattr(box.data.materials[0], "name", "body paint 2"),
        lambda: setattr(other, "parent", box),
        lambda: setattr(vehicle, "paint", "FACES"),
        lambda: bpy.context.scene.frame_set(5),
    ):
        change()
        before, times = times, card.redraw()
        assert times == before + 1
    bpy.data.objects.remove(box)
    assert card.redraw() > times
    assert card.laid[-1] == {}


def test_a_redraw_without_a_change_looks_for_nothing(vehicle, card, monkeypatch):
    a_box()
    vehicle.tint = True
    card.redraw()

    def look(self, context):
        raise AssertionError("among thousands of objects this takes milliseconds")

    monkeypatch.setattr(type(vehicle), "objects", look)
    card.redraw()
    assert [name for name, _ in card.drawn] == ["Box"]


def test_a_change_between_two_redraws_is_seen_behind_another(vehicle, card):
    box = a_box()
    vehicle.tint = True
    times = card.redraw()
    box.modifiers.new("more", "SUBSURF").subdivision_type = "SIMPLE"
    bpy.context.view_layer.update()
    box.location.x = 1.0
    bpy.context.view_layer.update()
    assert card.redraw() == times + 1
    box.location.x = 2.0
    bpy.context.view_layer.update()
    box.modifiers.clear()
    bpy.context.view_layer.update()
    assert card.redraw() == times + 2


def test_nothing_enters_the_file_and_no_handler_is_left(vehicle, card):
    a_box()
    before = {(kind, len(getattr(bpy.data, kind))) for kind in ("objects", "meshes", "materials", "node_groups")}
    attributes = [a.name for a in bpy.data.meshes["Box"].attributes]
    vehicle.tint = True
    card.redraw()
    assert {(kind, len(getattr(bpy.data, kind))) for kind, _ in before} == before
    assert [a.name for a in bpy.data.meshes["Box"].attributes] == attributes
    for name, handler in paint_overlay.HANDLERS.items():
        assert getattr(bpy.app.handlers, name).count(handler) == 1
    paint_overlay.unregister()
    for name, handler in paint_overlay.HANDLERS.items():
        assert handler not in getattr(bpy.app.handlers, name)
    paint_overlay.unregister()  # disabling goes on where a handler is gone already
