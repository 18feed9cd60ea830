"""Clips in Blender: where things stand, blur against the mean of many moments, ways that are not free."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from blender_addon.scene import driving, nodes, render
from blender_addon.scene.blocks import set_within
from blender_addon.scene.session import Session
from rauca_core.contract import Clips, Quality, RaucaError, Vehicle, Weather
from tests.blender.conftest import psnr, small_plan

TOWN = 20_004  # whose first place is free for every manoeuvre


def session_of(vehicle: Vehicle, clips: Clips, **changes: object) -> Session:
    return Session(small_plan(vehicle.atlas_id, clips=clips, size=64, seed=TOWN, min_visible=0.0, **changes), vehicle)


def test_camera_and_vehicle_stand_where_the_plan_says(box_vehicle: Vehicle):
    session = session_of(box_vehicle, Clips(("following",), 3, 10.0, 10.0))
    session.enter(0)
    session.set_weather(session.plan.weathers[0])
    found = session.annotations(0, [0, 2])
    assert min(one.visible for one in found.values()) > 0.9
    assert found[0].box_xyxy() == pytest.approx(found[2].box_xyxy(), abs=2)  # it drives as fast as the camera
    moved = session.pose(0, 2)[:3, 3] - session.pose(0, 0)[:3, 3]
    assert np.linalg.norm(moved) == pytest.approx(2.0, rel=1e-3)  # the street bends a little
    session.render(0, 2, session.plan.weathers[0])
    np.testing.assert_allclose(np.array(session.vehicle.object.matrix_world), session.pose(0, 2), atol=1e-5)


def test_blur_is_the_mean_of_the_open_shutter(box_vehicle: Vehicle):
    """And a frame's bytes do not depend on which frame was rendered before."""
    clips = Clips(("crossing",), 3, 10.0, 10.0, 0.05)
    flat = {"quality": Quality(128, denoise=False, bounces=1), "weathers": (Weather("day", 60.0),)}
    session = session_of(box_vehicle, clips, **flat)
    session.enter(0)
    day = session.plan.weathers[0]
    session.set_weather(day)
    blurred = session.render(0, 1, day)
    session.render(0, 2, day)
    np.testing.assert_array_equal(session.render(0, 1, day), blurred)
    # The same drive as still frames, nine of them while the shutter was open.
    many = Clips(("crossing",), 361, 10.0, 1800.0)
    still = session_of(box_vehicle, replace(many, frame_rate=1800.0), **flat)
    still.enter(0)
    still.set_weather(day)
    middle = 180
    moments = [still.render(0, middle + step, day) for step in range(-40, 41, 10)]
    exposed = 1 / blurred.max()
    sharp, mean = (np.clip(some * exposed, 0, 1) for some in (moments[4], np.mean(moments, axis=0)))
    against = np.clip(blurred * exposed, 0, 1)
    assert psnr(against, mean) > psnr(against, sharp) + 3
    assert not session.scene.render.use_motion_blur or still.scene.render.use_motion_blur is False


def test_a_way_through_what_stands_there_is_refused(box_vehicle: Vehicle):
    clips = Clips(("approach",), 12, 10.0, 10.0)
    session = session_of(box_vehicle, clips)
    session.enter(0)
    street = session.place.street(0)
    bpy.ops.mesh.primitive_cube_add(size=2.0)
    wall = bpy.context.active_object
    wall.name = "a wall"
    if wall.name not in session.scene.collection.objects:
        session.scene.collection.objects.link(wall)
    wall.location = street.at(driving.clips.Spot(-15.0))[:3, 3].tolist()
    with pytest.raises(RaucaError, match=r"here, approach: the camera's way runs into a wall at 0\.00 s; drive at"):
        driving.require_free_ways(session.scene, session.vehicle.object, street, clips, ["approach"], "here")


SIZE = 64  # pixels; 16 of them a metre in front of the bar
CLOSED = Quality(64, denoise=False, bounces=0)


@pytest.fixture
def passed_bar() -> bpy.types.Scene:
    """A bright upright bar of 0.4 m, 5 m in front of an orthographic camera that sees 4 m."""
    scene = bpy.data.scenes.new("a bar")
    render.prepare(scene)
    material = bpy.data.materials.new("bright")
    tree = nodes.fresh_tree(material)
    nodes.output(tree, Surface=nodes.add(tree, "ShaderNodeEmission").outputs[0])
    mesh = bpy.data.meshes.new("bar")
    mesh.from_pydata([(-0.2, -5, 0), (0.2, -5, 0), (0.2, 5, 0), (-0.2, 5, 0)], [], [(0, 1, 2, 3)])
    mesh.materials.append(material)
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 4.0
    for thing in (bpy.data.objects.new("bar", mesh), scene.camera):
        scene.collection.objects.link(thing)
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.render.film_transparent = True
    return scene


def drive_past(scene: bpy.types.Scene, driven: Clips) -> None:
    """To the right, in front of the bar at the view's time."""
    places = {frame: Matrix.Translation((driven.speed_m_s * s, 0, 5)) for frame, s in driving.keys(driven).items()}
    driving.move(scene, {scene.camera: places}, driven)


def bar_of(picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middle and width of the bar in every row, pixels."""
    shown = picture[..., 3]
    width = shown.sum(axis=1)
    return shown @ (np.arange(shown.shape[1]) + 0.5) / width, width


def spread_of(picture: np.ndarray, middle: np.ndarray) -> float:
    """Variance across about each row's middle, pixels squared; of all rows."""
    shown = picture[..., 3]
    across = np.arange(shown.shape[1]) + 0.5 - middle[:, None]
    return float((shown * across**2).sum() / shown.sum())


@pytest.mark.parametrize("shutter_s", [0.0, 0.03])
def test_a_rolling_shutter_skews_what_is_passed(passed_bar: bpy.types.Scene, shutter_s):
    """By the way between two rows' moments, to the other side than the camera goes; blurred as far as a row is open."""
    speed_m_s, readout_s, px_per_m = 10.0, 0.05, SIZE / 4
    drive_past(passed_bar, Clips(("passing",), 3, speed_m_s, 10.0, shutter_s, readout_s))
    whole = render.render_linear(passed_bar, CLOSED, 1)
    middle, width = bar_of(whole)
    row_s = readout_s / SIZE
    expected = SIZE / 2 - px_per_m * speed_m_s * row_s * (np.arange(SIZE) + 1 - SIZE / 2)
    np.testing.assert_allclose(middle, expected, atol=0.3)
    assert middle[0] - middle[-1] == pytest.approx(8 * 63 / 64, abs=0.2)
    np.testing.assert_allclose(width, 6.4, atol=0.4)  # light is spread, not lost
    crop = render.Crop(8, 16, 56, 40)
    np.testing.assert_array_equal(render.render_linear(passed_bar, CLOSED, 1, crop), whole[crop.inside])
    # Ids: without blur, where the rows are.
    with set_within(*driving.sharp(passed_bar)):
        ids = render.render_linear(passed_bar, CLOSED, 1)
    np.testing.assert_allclose(bar_of(ids)[0], expected, atol=0.15)
    blur = np.sqrt(12 * max(spread_of(whole, expected) - spread_of(ids, expected), 0.0))
    assert blur == pytest.approx(px_per_m * speed_m_s * shutter_s, rel=0.05, abs=0.3)
    # And next a shutter for all rows at once, which takes nothing over.
    drive_past(passed_bar, Clips(("passing",), 3, speed_m_s, 10.0, 0.05))
    middle, _ = bar_of(render.render_linear(passed_bar, CLOSED, 1))
    np.testing.assert_allclose(middle, SIZE / 2, atol=0.5)


def test_blur_is_as_long_as_the_way(passed_bar: bpy.types.Scene):
    drive_past(passed_bar, Clips(("passing",), 3, 10.0, 10.0, 0.1))  # 16 pixels
    still = Clips(("passing",), 3, 10.0, 10.0)
    blurred = render.render_linear(passed_bar, CLOSED, 1)
    drive_past(passed_bar, still)
    spreads = [
        spread_of(some, np.full(SIZE, SIZE / 2)) for some in (blurred, render.render_linear(passed_bar, CLOSED, 1))
    ]
    assert np.sqrt(12 * (spreads[0] - spreads[1])) == pytest.approx(16, rel=0.02)


def test_masks_and_ids_of_a_rolling_shutter_are_those_of_its_rows(box_vehicle: Vehicle):
    """Each row of a frame is that row of a still at the row's moment; camera and vehicle both move."""
    size, readout_s, speed_m_s, step = 64, 0.1, 30.0, 64
    ring = replace(small_plan(box_vehicle.atlas_id).ring, fov_deg=25.0)
    many = session_of(box_vehicle, Clips(("crossing",), 4 * step + 1, speed_m_s, size / readout_s), ring=ring)
    many.enter(0)
    views = {row: 2 * step + row + 1 - size // 2 for row in range(25, 45, 3)}
    still = many.annotations(0, views.values())
    middle = still[views[31]]
    for shutter_s in (0.0, 0.004):
        rolling = Clips(("crossing",), 5, speed_m_s, size / readout_s / step, shutter_s, readout_s)
        session = session_of(box_vehicle, rolling, ring=ring)
        session.enter(0)
        found = session.annotations(0, [2])[2]
        for row, view in views.items():
            assert ((found.instances[row] == 255) == (still[view].instances[row] == 255)).all()
            np.testing.assert_allclose(found.vehicle[row] / 255, still[view].vehicle[row] / 255, atol=0.15)
        off = [(middle.instances[row] != still[view].instances[row]).sum() for row, view in views.items()]
        assert sum(off) >= 6  # so the middle's rows would not do
