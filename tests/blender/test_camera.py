import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

from blender_addon.scene.camera import place
from rauca_core.contract import Camera, RaucaError


@pytest.mark.parametrize(("width", "height"), [(320, 320), (320, 200), (200, 320)])
def test_blender_projects_as_opencv_does(width, height):
    scene = bpy.data.scenes.new("camera test")
    base = Camera.look_at(np.array([6.0, -4.0, 2.5]), np.array([0.3, 0.1, 0.7]), 55.0, width, height, 5.0)
    K = base.K.copy()
    K[0, 2] += 11.0  # an off-center principal point
    K[1, 2] -= 7.0
    camera = Camera(K, base.R, base.t, width, height)
    place(scene, camera)
    scene.view_layers[0].update()
    points = np.random.default_rng(0).normal(size=(20, 3))
    ours, depth = camera.project(points)
    for point, pixel, z in zip(points, ours, depth, strict=True):
        view = world_to_camera_view(scene, scene.camera, Vector(point))
        assert (view.x * width, (1 - view.y) * height) == pytest.approx(tuple(pixel), abs=2e-3)
        assert view.z == pytest.approx(z, abs=1e-4)


def test_skewed_pixels_are_refused():
    camera = Camera(np.array([[100.0, 0, 50], [0, 120.0, 50], [0, 0, 1]]), np.eye(3), np.zeros(3), 100, 100)
    with pytest.raises(RaucaError, match="pixels must be square"):
        place(bpy.data.scenes.new("skew"), camera)
