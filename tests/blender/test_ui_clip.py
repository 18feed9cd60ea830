"""Step 3: a clip between two cameras, previewed on the timeline; leaving it gives everything back."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.blender.conftest import refusal

START, END = (-20.0, 0.0, 1.4), (-8.0, 5.0, 1.4)  # 13 m apart


@pytest.fixture
def empty_scene() -> bool:
    return False


@pytest.fixture
def clip(addon):
    """Two cameras, the second of which looks a quarter of a turn further to the left."""
    scene, found = addon.context.scene, []
    for name, place, turn in (("from", START, -90), ("to", END, 0)):
        lens = addon.data.cameras.new(name)
        lens.lens = 35.0
        camera = addon.data.objects.new(name, lens)
        camera.location, camera.rotation_euler = place, (math.radians(90), 0.0, math.radians(turn))
        scene.collection.objects.link(camera)
        found.append(camera)
    addon.context.view_layer.update()
    settings = scene.rauca.clip
    settings.start, settings.end, settings.speed, settings.frame_rate = *found, 6.5, 12.5
    return settings


def held(addon) -> dict[str, object]:
    """What of the file a preview could leave changed."""
    scene = addon.context.scene
    blocks = {kind: sorted(getattr(addon.data, kind).keys()) for kind in ("objects", "cameras", "actions")}
    timeline = (scene.frame_start, scene.frame_end, scene.frame_current, scene.use_preview_range)
    return {**blocks, "timeline": timeline, "rate": (scene.render.fps, scene.render.fps_base), "camera": scene.camera}


def test_the_camera_drives_straight_at_its_speed_and_turns_evenly(addon, clip):
    scene = addon.context.scene
    scene.frame_start = 11
    assert addon.ops.rauca.preview_clip() == {"FINISHED"}
    assert (scene.frame_start, scene.frame_end, clip.frames) == (11, 36, 26)  # two seconds
    assert scene.render.fps / scene.render.fps_base == pytest.approx(12.5)
    assert scene.camera == clip.camera
    assert clip.camera.data.lens == pytest.approx(35.0)
    poses = []
    for frame in range(11, 37):
        scene.frame_set(frame)
        poses.append(np.array(scene.camera.matrix_world))
    np.testing.assert_allclose(poses[0], np.array(clip.start.matrix_world), atol=1e-5)
    np.testing.assert_allclose(poses[-1], np.array(clip.end.matrix_world), atol=1e-5)
    steps = np.diff([pose[:3, 3] for pose in poses], axis=0)
    np.testing.assert_allclose(steps, np.tile(np.subtract(END, START) / 25, (25, 1)), atol=1e-5)
    turns = [math.degrees(math.atan2(pose[1, 0], pose[0, 0])) for pose in poses]
    np.testing.assert_allclose(np.diff(turns), 90 / 25, atol=1e-3)


def test_a_clip_ends_before_its_end_where_frames_do_not_fit(addon, clip):
    clip.speed = 12.0
    addon.ops.rauca.preview_clip()
    assert clip.frames == 14
    addon.context.scene.frame_set(addon.context.scene.frame_end)
    driven = np.linalg.norm(np.array(addon.context.scene.camera.matrix_world)[:3, 3] - START)
    assert driven == pytest.approx(13 * 12.0 / 12.5, abs=1e-4)


def test_leaving_gives_everything_back(addon, clip, tmp_path):
    scene = addon.context.scene
    scene.frame_start, scene.frame_end, scene.use_preview_range = 40, 90, True
    scene.frame_set(55)
    before = held(addon)
    addon.ops.rauca.preview_clip()
    assert held(addon) != before
    scene.frame_set(45)
    addon.ops.wm.save_as_mainfile(filepath=str(tmp_path / "clip.blend"))
    addon.ops.wm.open_mainfile(filepath=str(tmp_path / "clip.blend"))
    assert addon.ops.rauca.leave_clip() == {"FINISHED"}
    after = held(addon)
    assert after["camera"].type == "CAMERA"
    assert {**after, "camera": None} == {**before, "camera": None}
    assert not addon.context.scene.rauca.clip.previewed
    assert "No clip is previewed" in refusal(addon.ops.rauca.leave_clip)


def test_a_preview_that_was_deleted_by_hand_can_be_left(addon, clip):
    own = addon.context.scene.camera
    addon.ops.rauca.preview_clip()
    addon.data.objects.remove(clip.camera)
    addon.ops.rauca.leave_clip()
    assert addon.context.scene.camera == own


def test_what_cannot_be_driven_is_refused(addon, clip):
    clip.speed, clip.frame_rate = 100.0, 1.0
    assert "lower the speed" in refusal(addon.ops.rauca.preview_clip)
    clip.speed, clip.frame_rate = 0.1, 100.0
    assert "more than 3000 frames" in refusal(addon.ops.rauca.preview_clip)
    clip.speed, clip.frame_rate = 10.0, 15.0
    addon.ops.rauca.look_through()
    assert "Leave the view" in refusal(addon.ops.rauca.preview_clip)
    addon.ops.rauca.leave_view()
    addon.ops.rauca.preview_clip()
    assert "previewed already" in refusal(addon.ops.rauca.preview_clip)
    addon.ops.rauca.look_through()
    assert "Leave the view" in refusal(addon.ops.rauca.leave_clip)
    addon.ops.rauca.leave_view()
    addon.ops.rauca.leave_clip()
    clip.end = clip.start
    assert "Pick two cameras" in refusal(addon.ops.rauca.preview_clip)
