"""Step 3: the ring as the job renders it, drawn, looked through and timed."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from blender_addon.scene.mesh_edits import Surface, mark_faces
from blender_addon.scene.ring import ring_lines
from blender_addon.scene.vehicle import SceneVehicle
from blender_addon.scene.vehicle_arrays import read_objects
from blender_addon.scene.vehicle_reading import find_anchor
from blender_addon.scene.vehicle_request import VehicleRequest, orient
from blender_addon.steps.cameras import overlay, timing
from blender_addon.steps.cameras.panel import state
from blender_addon.steps.cameras.properties import anchor
from blender_addon.steps.cameras.timing import Pace, learn, recall
from rauca_core.contract import LedgerEntry, Plan, RaucaError, Ring, append_entry
from rauca_core.contract.files import write_json
from rauca_core.contract.viewpoints import viewpoint
from tests.blender.conftest import refusal, small_plan

JITTERY = Ring((0.0, 90.0, 200.0), (10.0, 85.0), (6.0, 9.0), 12.0, 8.0, 0.1, 0.2, 5.0, 70.0)
POSE = np.array([[0.0, -1, 0, 3], [1, 0, 0, -2], [0, 0, 1, 0.5], [0, 0, 0, 1]])
CENTER = np.array([0.1, 0.0, 0.7])


@pytest.fixture
def empty_scene() -> bool:
    return False


@pytest.fixture
def cameras(addon):
    return addon.context.scene.rauca.cameras


def a_plan(**changes: object) -> Plan:
    return small_plan("0" * 16, **({"size": 320, "ring": JITTERY, "locations": 2} | changes))


def lines(shots, chosen: int = 0):
    return ring_lines(shots, 1, chosen, POSE, CENTER)


def polar(points):
    """Azimuth, elevation (degrees) and distance (metres) of world points, seen from the vehicle's middle."""
    local = (np.asarray(points, float) - POSE[:3, 3]) @ POSE[:3, :3] - CENTER
    distance = np.linalg.norm(local, axis=-1)
    azimuth = np.degrees(np.arctan2(local[..., 1], local[..., 0]))
    return azimuth, np.degrees(np.arcsin(local[..., 2] / distance)), distance


def test_cameras_are_drawn_where_the_job_puts_them():
    """A drawn camera's apex is the job's eye, its far corners lie on the rays of the picture's corners."""
    plan = a_plan()
    views = [view for view in range(len(plan.ring)) if view != 4]
    drawn = lines(plan, chosen=4).cameras.reshape(len(views), 11, 2, 3)
    for view, frustum in zip(views, drawn, strict=True):
        camera = viewpoint(plan, 1, view, POSE, CENTER).camera
        np.testing.assert_allclose(frustum[:4, 0], np.tile(camera.position, (4, 1)), atol=1e-5)
        seen = (camera.K @ (camera.R @ frustum[:4, 1].astype(float).T + camera.t[:, None])).T
        corners = np.array([[0, 0], [320, 0], [320, 320], [0, 320]])
        np.testing.assert_allclose(seen[:, :2] / seen[:, 2:], corners, atol=0.05)


def test_the_chosen_view_looks_at_the_vehicle():
    drawn = lines(a_plan(ring=Ring((30.0,), (20.0,), (7.0,)))).chosen
    assert drawn.shape == (12, 2, 3)
    eye, target = drawn[-1]
    assert np.linalg.norm(eye - target) == pytest.approx(7.0, abs=1e-4)
    np.testing.assert_allclose(target, POSE[:3, :3] @ CENTER + POSE[:3, 3], atol=1e-5)


def test_circles_lie_at_every_height_and_distance():
    plan = a_plan()
    _, elevation, distance = polar(lines(plan).circles.reshape(-1, 3))
    found = {(round(e), round(d)) for e, d in zip(elevation.tolist(), distance.tolist(), strict=True)}
    assert found == {(10, 6), (10, 9), (85, 6), (85, 9)}


def test_every_camera_is_inside_the_range_that_is_drawn_for_it():
    ring = Ring((40.0,), (20.0,), (7.0,), 12.0, 8.0, 0.1)
    plan = a_plan(ring=ring)
    azimuth, elevation, distance = polar(lines(plan).ranges.reshape(-1, 3))
    # Azimuths against the vehicle's own axes.
    assert (azimuth.min(), azimuth.max()) == pytest.approx((28.0, 52.0), abs=1e-3)
    assert (elevation.min(), elevation.max()) == pytest.approx((12.0, 28.0), abs=1e-3)
    assert (distance.min(), distance.max()) == pytest.approx((6.3, 7.7), abs=1e-4)
    for seed in range(20):
        view = viewpoint(a_plan(ring=ring, seed=seed), 1, 0, POSE, CENTER)
        assert azimuth.min() <= view.azimuth_deg <= azimuth.max()
        assert elevation.min() <= view.elevation_deg <= elevation.max()
        assert distance.min() <= view.distance_m <= distance.max()


def test_no_jitter_draws_no_range_and_nothing_goes_underground():
    drawn = lines(a_plan(ring=Ring((0.0, 180.0), (-10.0,), (20.0,))))
    assert drawn.ranges.shape == (0, 2, 3)
    assert drawn.circles[..., 2].min() == pytest.approx(POSE[2, 3] + 0.3)
    straight_up = lines(a_plan(ring=Ring((0.0,), (89.0,), (20.0,), jitter_elevation_deg=20.0)))
    _, elevation, _ = polar(straight_up.ranges.reshape(-1, 3))
    assert elevation.max() <= 89.0 + 1e-3


def test_large_rings_stay_drawable():
    many = Ring(tuple(float(i) for i in range(360)), (5.0, 15.0, 25.0), (6.0, 8.0, 10.0), 2.0)
    drawn = lines(a_plan(ring=many), chosen=17)
    assert 0 < len(drawn.cameras) <= 400 * 11
    assert len(drawn.ranges) == 2 * 0 + 6  # only the chosen view's: one edge of six pieces


def test_the_ring_is_what_the_panel_says(addon, cameras):
    assert cameras.ring() == Ring(tuple(i * 45.0 for i in range(8)), (10.0, 25.0), (6.0, 10.0), fov_deg=60.0)
    cameras.azimuths, cameras.elevations, cameras.distances = 3, 3, 1
    cameras.jitter_distance, cameras.jitter_roll = 12.0, math.radians(4)
    assert cameras.ring() == Ring(
        (0.0, 120.0, 240.0), (10.0, 17.5, 25.0), (8.0,), jitter_distance=0.12, jitter_roll_deg=4.0
    )


class _DrawnError(Exception):
    """In place of drawing, which needs a window."""


def test_a_new_scene_shows_no_ring(addon, cameras, monkeypatch):
    """Rings are drawn once a vehicle is there and a setting was changed, or where somebody asks for them."""

    def draw() -> None:
        overlay._draw(SimpleNamespace(scene=addon.context.scene, region_data=SimpleNamespace(view_perspective="PERSP")))

    def lay_on_card(key, make):
        raise _DrawnError

    monkeypatch.setattr(overlay._ring, "kept", lay_on_card)
    assert state(addon.context).kind == "ready"
    draw()
    addon.ops.rauca.add_vehicle(vehicle="cube")
    draw()
    cameras.azimuths = 5
    assert state(addon.context).kind == "done"
    with pytest.raises(_DrawnError):
        draw()
    cameras.overlay = False
    cameras.azimuths = 6  # what was switched off by hand stays off
    draw()
    cameras.overlay = True
    addon.data.objects.remove(addon.context.scene.rauca.vehicle.object)
    draw()


def test_looking_through_and_leaving_gives_everything_back(addon, cameras):
    scene = addon.context.scene
    own, size, objects = scene.camera, scene.render.resolution_x, len(addon.data.objects)
    assert addon.ops.rauca.look_through(step=1) == {"FINISHED"}
    assert cameras.view == 2
    assert scene.camera not in (None, own)
    assert (scene.render.resolution_x, scene.render.resolution_y) == (320, 320)
    matrix = np.array(scene.camera.matrix_world)
    np.testing.assert_allclose(matrix[:3, 3], cameras.viewpoint(addon.context).camera.position, atol=1e-5)
    cameras.distance_near = 12.0  # the view follows
    assert np.linalg.norm(np.array(scene.camera.matrix_world)[:3, 3] - [0, 0, 0.75]) == pytest.approx(12.0, abs=1e-4)
    assert addon.ops.rauca.leave_view() == {"FINISHED"}
    assert (scene.camera, scene.render.resolution_x, len(addon.data.objects)) == (own, size, objects)
    assert "No view is being looked through" in refusal(addon.ops.rauca.leave_view)


def test_views_go_round(addon, cameras):
    cameras.view = 999
    assert cameras.chosen() == 31
    addon.ops.rauca.look_through(step=1)
    assert cameras.view == 1
    addon.ops.rauca.look_through(step=-1)
    assert cameras.view == 32


def test_the_view_survives_saving_and_undo(addon, cameras, tmp_path):
    addon.ops.ed.undo_push(message="before")
    own = addon.context.scene.camera.name
    addon.ops.rauca.look_through()
    addon.ops.ed.undo_push(message="looking")
    addon.ops.ed.undo()
    assert addon.context.scene.camera.name == own
    addon.ops.ed.redo()
    addon.ops.wm.save_as_mainfile(filepath=str(tmp_path / "view.blend"))
    addon.ops.wm.open_mainfile(filepath=str(tmp_path / "view.blend"))
    assert addon.context.scene.rauca.cameras.looking
    addon.ops.rauca.leave_view()
    assert addon.context.scene.camera.name == own


@pytest.mark.parametrize("front", ["AUTO", "+X", "-X", "+Y", "-Y"])
def test_the_anchor_of_an_artists_mesh_is_how_it_will_be_read(addon, front):
    cube = addon.data.objects["Cube"]
    cube.scale, cube.location, cube.rotation_euler = (0.9, 2.1, 0.7), (5.0, 1.0, 0.7), (0.0, 0.0, 0.1)
    addon.context.view_layer.update()
    soup = read_objects([cube])
    request = VehicleRequest("cube", front=front)
    in_world = soup.positions
    orient(soup, request)
    found = find_anchor([cube], request)
    turn, place = found.vehicle_to_world[:3, :3], found.vehicle_to_world[:3, 3]
    np.testing.assert_allclose(soup.positions @ turn.T + place, in_world, atol=1e-5)
    middle = (soup.positions.min(axis=0) + soup.positions.max(axis=0)) / 2
    np.testing.assert_allclose(found.center, middle, atol=1e-5)


@pytest.mark.parametrize("paint", ["SHIPPED", "MATERIAL", "FACES"])
def test_the_anchor_is_the_jobs_whatever_is_paint_and_whatever_else_hangs_on_the_vehicle(addon, paint):
    """A shipped vehicle turned by 90 degrees, with a camera for a child; with paint of his own its mesh is read."""
    assert not anchor(addon.context).found
    addon.ops.rauca.add_vehicle(vehicle="sedan")
    chosen = addon.context.scene.rauca.vehicle
    thing = chosen.object
    rig = addon.data.objects.new("rig", addon.data.cameras.new("rig"))
    addon.context.scene.collection.objects.link(rig)
    rig.parent, rig.location, thing.rotation_euler.z = thing, (-12.0, 0.0, 4.0), math.radians(90)
    thing.location = (4.0, -3.0, 0.2)
    addon.context.view_layer.update()
    where, middle = np.array(thing.matrix_world), anchor(addon.context).center
    if paint == "MATERIAL":
        chosen.material = next(m for m in thing.data.materials if "paint" in m.name)
    elif paint == "FACES":
        mark_faces(thing.data, np.arange(len(thing.data.polygons)) < 100)
        chosen.paint = "FACES"
    if paint != "SHIPPED":
        read = chosen.chosen(addon.context)
        where = Surface.of(read, chosen.objects(addon.context)).vehicle_to_world()
    found, job = anchor(addon.context), SceneVehicle(addon.data.scenes.new("job"), chosen.chosen(addon.context))
    assert found.found
    np.testing.assert_allclose(found.vehicle_to_world, where, atol=1e-5)
    np.testing.assert_allclose(found.center, job.center, atol=1e-5)
    np.testing.assert_allclose(found.center, middle, atol=1e-2)
    assert middle[2] < 1.0


def test_the_estimate_counts_every_frame_and_learns_from_a_dataset(addon, tmp_path):
    steps = addon.context.scene.rauca
    steps.dataset.locations = 3
    timing._kept.clear()
    assert timing.frame_count(addon.context) == 8 * 2 * 2 * 3 * 3
    steps.dataset.part = 50
    assert timing.frame_count(addon.context) == 50
    steps.dataset.part = 10_000
    assert timing.frame_count(addon.context) == 8 * 2 * 2 * 3 * 3
    steps.dataset.part = 0
    write_json(tmp_path / "dataset.json", a_plan().to_json())
    append_entry(tmp_path, LedgerEntry("a", "done", 2.0))
    timing.learn(tmp_path, workers=1)
    assert timing.pace().frames == 0  # too few
    for name, seconds in zip("bcde", (2.0, 2.5, 2.0, 90.0), strict=True):
        append_entry(tmp_path, LedgerEntry(name, "done", seconds))
    timing.learn(tmp_path, workers=1)
    assert timing.pace().frames == 5
    assert timing.estimated_seconds(addon.context) == pytest.approx(2.0 * timing.frame_count(addon.context))
    for name in "fghij":
        append_entry(tmp_path, LedgerEntry(name, "done", 1.0))
    timing.learn(tmp_path, workers=1)
    assert timing.estimated_seconds(addon.context) == pytest.approx(1.5 * timing.frame_count(addon.context))
    timing.learn(tmp_path, workers=3)  # three frames at once, each in 1.5 s
    assert timing.estimated_seconds(addon.context) == pytest.approx(0.5 * timing.frame_count(addon.context))
    timing.learn(tmp_path, workers=1)
    steps.dataset.samples = 64
    assert timing.estimated_seconds(addon.context) > 4.5 * timing.frame_count(addon.context)


def test_a_damaged_pace_is_a_guess(tmp_path):
    assert recall(tmp_path) == Pace()
    write_json(tmp_path / "pace.json", {"factor": 0.5, "frames": 40})
    assert recall(tmp_path) == Pace(0.5, 40)
    for text in ("{", json.dumps({"factor": "x"}), json.dumps({"factor": -1.0, "frames": 3}), "[]", "[" * 100_000):
        (tmp_path / "pace.json").write_text(text)
        assert recall(tmp_path) == Pace()
    with pytest.raises(RaucaError):
        learn(tmp_path, 1)


def test_a_preset_sets_the_rings_and_says_how_many_views(addon, cameras):
    cameras.jitter_roll = 0.1
    choices = addon.ops.rauca.camera_preset.get_rna_type().properties["preset"].enum_items
    for choice in choices:
        addon.ops.rauca.camera_preset(preset=choice.identifier)
        assert choice.description.startswith(f"{len(cameras.ring())} views")
        assert cameras.jitter_roll == pytest.approx(0.1)
    addon.ops.rauca.camera_preset(preset="STANDARD")
    assert cameras.ring() == replace(contract_ring(), jitter_roll_deg=cameras.ring().jitter_roll_deg)


def contract_ring() -> Ring:
    """What the settings are to begin with."""
    around = tuple(45.0 * i for i in range(8))
    return Ring(azimuths_deg=around, elevations_deg=(10.0, 25.0), distances_m=(6.0, 10.0), fov_deg=60.0)
