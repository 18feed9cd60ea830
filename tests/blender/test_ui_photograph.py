"""The photograph of step 7: marked by clicks, fitted by `rauca picture add`, shown in its own light, and left again."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector

from blender_addon.preferences import preferences
from blender_addon.scene.camera import aim, new_holder, seen_by
from blender_addon.scene.vehicle import load_shipped
from blender_addon.steps.cameras.properties import anchor
from blender_addon.steps.photograph import marking, operators
from blender_addon.steps.photograph.panel import state
from blender_addon.steps.photograph.properties import standing
from rauca_core.contract import Camera
from rauca_core.contract.files import png_bytes
from rauca_core.environment.views.body import see_body
from rauca_core.runtime.images import read_image
from tests.blender.conftest import refusal
from tests.blender.painted_box import a_camouflage, noise

from .test_ui_optimize import CHECKED

WIDE, HIGH = 240, 161
TRUTH = Camera.look_at(np.array([5.0, 4.0, 2.5]), np.array([0.0, 0, 0.7]), 60.0, WIDE, HIGH)


@pytest.fixture
def photograph(addon, tmp_path):
    """The sedan somewhere in the scene, and a picture of it: shaded by height, its paint red; the camera is known."""
    settled = preferences(addon.context)
    settled.python = sys.executable
    settled.keep(Path(sys.executable), CHECKED)
    addon.ops.rauca.add_vehicle(vehicle="sedan")
    sedan = addon.context.scene.rauca.vehicle.object
    sedan.location, sedan.rotation_euler.z = (3.0, -2.0, 0.5), 0.7
    addon.context.view_layer.update()
    paint = see_body(load_shipped("sedan"), TRUTH).paint[..., None]
    shade = np.linspace(1.0, 0.6, HIGH)[:, None, None]
    picture = 90 + (shade * np.array([190, 40, 30]) - 90) * paint
    (tmp_path / "car.png").write_bytes(png_bytes(picture.astype(np.uint8)))
    settings = addon.context.scene.rauca.photograph
    settings.file, settings.folder = str(tmp_path / "car.png"), str(tmp_path / "photograph")
    return settings


def shoot(pixel: np.ndarray) -> np.ndarray | None:
    """What a click on a place of the true camera's picture marks on the vehicle, in its own frame."""
    to_world = anchor(bpy.context).vehicle_to_world
    way = TRUTH.R.T @ np.linalg.solve(TRUTH.K, np.array([*pixel, 1.0]))
    origin = to_world @ [*TRUTH.position, 1.0]
    return marking.vehicle_point(bpy.context, Vector(origin[:3]), Vector(to_world[:3, :3] @ way).normalized())


def mark_eight(settings) -> None:
    """Eight clicks over the vehicle, each with its place in the picture."""
    seen = see_body(load_shipped("sedan"), TRUTH)
    rows, columns = np.nonzero(seen.center)
    for row, column in np.random.default_rng(2).permutation(np.c_[rows, columns])[:8]:
        pixel = np.array([column, row]) + 0.5
        point = shoot(pixel)
        assert point is not None
        marking.add_mark(settings, point, pixel)


def in_vehicle_frame() -> Camera:
    """The camera that the scene looks through."""
    scene = bpy.context.scene
    render = scene.render
    seen = seen_by(scene.camera, render.resolution_x, render.resolution_y)
    return seen.relative_to(anchor(bpy.context).vehicle_to_world)


def assert_is_truth(found: Camera) -> None:
    cosine = (np.trace(found.R @ TRUTH.R.T) - 1) / 2
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))) < 0.5
    assert np.linalg.norm(found.position - TRUTH.position) < 0.02
    assert found.fov_deg == pytest.approx(TRUTH.fov_deg, abs=0.5)


def test_marks_fit_the_camera_and_the_camouflage_is_composed_on_the_paint_alone(addon, photograph, tmp_path):
    own, objects = addon.context.scene.camera, len(addon.data.objects)
    assert addon.ops.rauca.look_at_photograph() == {"FINISHED"}
    render = addon.context.scene.render
    assert (render.resolution_x, render.resolution_y) == (WIDE, HIGH)
    mark_eight(photograph)
    assert state(addon.context).words == "8 points are marked; press Fit"
    assert "Fit the photograph first" in refusal(addon.ops.rauca.wear_photograph)
    assert addon.ops.rauca.fit_photograph() == {"FINISHED"}
    assert_is_truth(in_vehicle_frame())
    assert 0 <= photograph.missed_px < 0.1
    assert "Choose a camouflage" in refusal(addon.ops.rauca.wear_photograph)
    a_camouflage(tmp_path, noise(), load_shipped("sedan").atlas_id, "sedan")
    assert state(addon.context).words.startswith("Fitted: the marks are missed by 0.")
    assert addon.ops.rauca.wear_photograph() == {"FINISHED"}
    (laid,) = addon.context.scene.camera.data.background_images
    assert laid.display_depth == "FRONT"
    shown = read_image(Path(bpy.path.abspath(laid.image.filepath)))
    _assert_worn(shown)
    assert addon.ops.rauca.leave_photograph() == {"FINISHED"}
    assert not addon.data.images.get("car.png")
    assert laid_pictures() == []
    assert (addon.context.scene.camera, len(addon.data.objects)) == (own, objects)
    assert "No view is being looked through" in refusal(addon.ops.rauca.leave_photograph)
    addon.ops.rauca.look_at_photograph()  # another day: through the camera that was found
    assert_is_truth(in_vehicle_frame())
    (tmp_path / "other.png").write_bytes((tmp_path / "car.png").read_bytes())
    photograph.file = str(tmp_path / "other.png")
    assert "Fit the photograph first" in refusal(addon.ops.rauca.wear_photograph)


def laid_pictures() -> list[str]:
    return [image.name for image in bpy.data.images if image.packed_file is None and image.source == "FILE"]


def _assert_worn(shown: np.ndarray) -> None:
    """Between grey bars the photograph, other on the paint and nowhere else."""
    folder = Path(bpy.context.scene.rauca.photograph.folder)
    up = (WIDE - HIGH) // 2
    inside = shown[up : up + HIGH].astype(int)
    plain = read_image(folder.parent / "car.png").astype(int)
    paint = see_body(load_shipped("sedan"), TRUTH).paint
    apart = np.abs(inside - plain).max(axis=2)
    assert (shown[:up] == 114).all()
    assert apart[paint == 0].max() <= 1
    assert np.median(apart[paint > 0.99]) > 15


def test_a_camera_pulled_into_place_is_taken_as_it_stands(addon, photograph):
    addon.ops.rauca.look_at_photograph()
    to_world = anchor(addon.context).vehicle_to_world
    aim(addon.context.scene.camera, TRUTH.relative_to(np.linalg.inv(to_world)))
    addon.context.view_layer.update()
    assert addon.ops.rauca.fit_photograph() == {"FINISHED"}
    assert_is_truth(operators.fitted_camera(Path(photograph.folder)))
    assert_is_truth(in_vehicle_frame())
    assert photograph.missed_px < 0
    assert not (Path(photograph.folder) / "points.json").exists()


def test_what_keeps_a_photograph_from_being_fitted(addon, photograph, tmp_path):
    assert "Look at the photograph first" in refusal(addon.ops.rauca.fit_photograph)
    (tmp_path / "words.png").write_text("no picture")
    photograph.file = str(tmp_path / "words.png")
    assert "words.png: is no picture" in refusal(addon.ops.rauca.look_at_photograph)
    photograph.file = str(tmp_path / "gone.png")
    assert "gone.png: cannot be read" in refusal(addon.ops.rauca.look_at_photograph)
    assert photograph.camera is None
    photograph.file = str(tmp_path / "car.png")
    addon.ops.rauca.look_at_photograph()
    marking.add_mark(photograph, (1.0, 0.5, 0.5), (10.0, 10.0))
    assert "1 of at least 6 points" in refusal(addon.ops.rauca.fit_photograph)
    addon.ops.rauca.remove_marks(which="LAST")
    assert "No point is marked" in refusal(addon.ops.rauca.remove_marks)
    photograph.folder = str(tmp_path)
    assert "holds other files" in refusal(addon.ops.rauca.fit_photograph)
    photograph.folder = ""
    assert state(addon.context).words == "Choose a folder for the photograph"


def test_views_are_left_in_the_order_that_gives_the_own_camera_back(addon, photograph):
    """Another order would bring a camera back that is gone."""
    scene = addon.context.scene
    own = scene.camera = new_holder()
    scene.collection.objects.link(own)
    size = scene.render.resolution_x
    addon.ops.rauca.look_through(step=1)
    addon.ops.rauca.look_at_photograph()
    assert "Leave the view" in refusal(addon.ops.rauca.look_through)
    assert "Leave the view" in refusal(addon.ops.rauca.leave_view)
    addon.ops.rauca.leave_photograph()
    addon.ops.rauca.look_through(step=1)
    addon.ops.rauca.leave_view()
    assert (scene.camera, scene.render.resolution_x) == (own, size)


def test_nothing_is_marked_before_a_photograph_is_chosen(addon, photograph):
    photograph.file = ""
    assert "Choose a photograph first" in refusal(addon.ops.rauca.mark_points)
    assert state(addon.context).words == "Choose a photograph first"


def test_a_vehicle_that_is_a_file_stands_where_step_6_placed_it(addon, photograph, tmp_path):
    vehicle = addon.context.scene.rauca.vehicle
    here = anchor(addon.context).vehicle_to_world
    addon.data.objects.remove(vehicle.object)
    vehicle.origin, vehicle.file = "FILE", "sedan"
    assert "The vehicle is not in this scene" in refusal(addon.ops.rauca.look_at_photograph)
    a_camouflage(tmp_path, noise(), load_shipped("sedan").atlas_id, "sedan")
    addon.ops.rauca.apply_camouflage()
    (sedan,) = addon.context.scene.objects
    sedan.matrix_world = Matrix(here.tolist())
    addon.context.view_layer.update()
    found = standing(addon.context)
    assert found is not None
    assert found.objects == [sedan]
    np.testing.assert_allclose(found.to_world, here, atol=1e-6)
    assert addon.ops.rauca.look_at_photograph() == {"FINISHED"}


def test_marks_of_one_plane_are_refused_by_the_command_in_one_line(addon, photograph):
    addon.ops.rauca.look_at_photograph()
    for i in range(6):
        marking.add_mark(photograph, (i, i**2, 0.0), (20.0 * i, 50.0))
    assert "all points lie in one plane" in refusal(addon.ops.rauca.fit_photograph)
    assert len(json.loads((Path(photograph.folder) / "points.json").read_text())["points"]) == 6


def test_a_click_beside_the_vehicle_or_behind_fog_is_told_apart(addon, photograph):
    """The first surface that is the vehicle's counts, whatever lies before it; nothing where there is none."""
    on_door = TRUTH.project(np.array([[0.0, 0.9, 0.6]]))[0][0]
    plain = shoot(on_door)
    assert plain is not None
    assert plain[1] > 0.5  # the left side
    wall = addon.data.meshes.new("wall")
    wall.from_pydata([(-9, 0, -9), (9, 0, -9), (9, 0, 9), (-9, 0, 9)], [], [(0, 1, 2, 3)])
    before = addon.data.objects.new("wall", wall)
    addon.context.collection.objects.link(before)
    before.matrix_world = addon.context.scene.rauca.vehicle.object.matrix_world.copy()
    before.location = before.matrix_world @ Vector((0.0, 2.0, 0.0))
    addon.context.view_layer.update()
    np.testing.assert_allclose(shoot(on_door), plain, atol=1e-4)
    assert shoot(np.array([2.0, 2.0])) is None


def test_places_of_the_region_are_pixels():
    frame = (100.0, 50.0, 340.0, 211.0)
    assert marking.pixel_at(frame, (WIDE, HIGH), 100.5, 210.5) == pytest.approx((0.5, 0.5))
    assert marking.pixel_at(frame, (2 * WIDE, 2 * HIGH), 340.0, 50.0) == pytest.approx((2 * WIDE, 2 * HIGH))
    assert marking.pixel_at(frame, (WIDE, HIGH), 99.0, 100.0) is None


def test_clicks_on_the_sidebar_are_left_to_it():
    def region(kind, x, width, height=600):
        return SimpleNamespace(type=kind, x=x, y=20, width=width, height=height)

    window, sidebar, closed = region("WINDOW", 0, 800), region("UI", 600, 200), region("TOOLS", 0, 1, 1)
    area = SimpleNamespace(regions=[closed, sidebar, window])
    assert marking.window_under(area, 300, 300) is window
    assert marking.window_under(area, 700, 300) is None
    assert marking.window_under(area, 300, 10) is None


@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
def test_a_blender_camera_is_read_back(addon, fit):
    holder = new_holder()
    aim(holder, TRUTH)
    if fit != "AUTO":  # the same camera, said in another way
        across = {"HORIZONTAL": WIDE, "VERTICAL": HIGH}[fit]
        holder.data.sensor_fit, holder.data.sensor_height = fit, holder.data.sensor_width
        holder.data.lens *= max(WIDE, HIGH) / across
    found = seen_by(holder, WIDE, HIGH)
    for name in ("K", "R", "t"):
        np.testing.assert_allclose(getattr(found, name), getattr(TRUTH, name), atol=1e-4)


def test_undo_takes_marks_back_and_the_view_survives_saving(addon, photograph, tmp_path):
    addon.ops.rauca.look_at_photograph()
    addon.ops.ed.undo_push(message="looking")
    marking.add_mark(photograph, (1.0, 0.5, 0.5), (10.0, 10.0))
    addon.ops.ed.undo_push(message="a mark")
    addon.ops.ed.undo()
    assert len(addon.context.scene.rauca.photograph.marks) == 0
    addon.ops.ed.redo()
    assert len(addon.context.scene.rauca.photograph.marks) == 1
    addon.ops.wm.save_as_mainfile(filepath=str(tmp_path / "photo.blend"))
    addon.ops.wm.open_mainfile(filepath=str(tmp_path / "photo.blend"))
    assert tuple(addon.context.scene.rauca.photograph.marks[0].pixel) == (10.0, 10.0)
    assert addon.ops.rauca.leave_photograph() == {"FINISHED"}
    assert addon.context.scene.camera is None
    assert laid_pictures() == []
