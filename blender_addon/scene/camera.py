"""A contract camera as Blender's; looking through it in the artist's scene, whose own camera is left alone."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix

from ..core import contract
from .overrides import Setting, override, restore

SENSOR_MM = 36.0


def place(scene: bpy.types.Scene, camera: contract.Camera) -> None:
    """Make ``camera`` the scene's camera and set the resolution to its size; raises as :func:`aim`."""
    if scene.camera is None:
        scene.camera = new_holder()
        scene.collection.objects.link(scene.camera)
    aim(scene.camera, camera)
    override(scene, "", _picture(camera))


def _picture(camera: contract.Camera) -> dict[str, Setting]:
    size = {"render.resolution_x": camera.width, "render.resolution_y": camera.height}
    return {**size, "render.resolution_percentage": 100, "render.pixel_aspect_x": 1.0, "render.pixel_aspect_y": 1.0}


def new_holder() -> bpy.types.Object:
    """A camera object, in no scene yet."""
    return bpy.data.objects.new("rauca camera", bpy.data.cameras.new("rauca camera"))


def aim(holder: bpy.types.Object, camera: contract.Camera) -> None:
    """Give a camera object a contract camera's place and lens; :class:`RaucaError` unless its pixels are square."""
    if not np.isclose(camera.K[0, 0], camera.K[1, 1], rtol=1e-6) or abs(camera.K[0, 1]) > 1e-9:
        raise contract.RaucaError("camera: pixels must be square and without skew (K[0][0] = K[1][1], K[0][1] = 0)")
    lens = holder.data
    larger = max(camera.width, camera.height)
    lens.sensor_fit = "AUTO"
    lens.sensor_width = SENSOR_MM
    lens.lens = camera.K[0, 0] * SENSOR_MM / larger
    lens.shift_x = (camera.width / 2 - camera.K[0, 2]) / larger
    lens.shift_y = (camera.K[1, 2] - camera.height / 2) / larger
    lens.clip_start, lens.clip_end = 0.02, 5000.0

    holder.matrix_world = stand(camera)


def seen_by(holder: bpy.types.Object, width: int, height: int) -> contract.Camera:
    """The contract camera that a camera object is, for pictures of a size; undoes :func:`aim`, in any sensor's fit."""
    lens, larger = holder.data, max(width, height)
    sensor = lens.sensor_height if lens.sensor_fit == "VERTICAL" else lens.sensor_width
    across = {"AUTO": larger, "HORIZONTAL": width, "VERTICAL": height}[lens.sensor_fit]
    focal, place = lens.lens * across / sensor, np.array(holder.matrix_world.normalized())
    center = width / 2 - lens.shift_x * across, height / 2 + lens.shift_y * across
    R = np.diag([1.0, -1.0, -1.0]) @ place[:3, :3].T
    K = np.array([[focal, 0, center[0]], [0, focal, center[1]], [0, 0, 1.0]])
    return contract.Camera(K, R, -R @ place[:3, 3], width, height)


def stand(camera: contract.Camera) -> Matrix:
    """Where a camera object stands for a contract camera."""
    to_blender = np.diag([1.0, -1.0, -1.0])  # Blender's camera looks along -z with y up
    pose = np.eye(4)
    pose[:3, :3] = camera.R.T @ to_blender
    pose[:3, 3] = camera.position
    return Matrix(pose.tolist())


def look(scene: bpy.types.Scene, kept: bpy.types.PropertyGroup, camera: contract.Camera) -> None:
    """Make a view's camera the scene's, its picture as large as the data set's.

    Args:
        kept: where the scene keeps the view's ``camera`` and what it replaced: ``camera_before`` and ``overrides``.
    """
    if kept.camera is None:
        kept.camera = new_holder()
        kept.camera.hide_select = True
    if kept.camera.name not in scene.objects:
        scene.collection.objects.link(kept.camera)
    if scene.camera != kept.camera:
        kept.camera_before, scene.camera = scene.camera, kept.camera
    aim(kept.camera, camera)
    kept.overrides = override(scene, kept.overrides, _picture(camera))


def leave(scene: bpy.types.Scene, kept: bpy.types.PropertyGroup) -> None:
    """Give the scene its own camera and picture size back; the view's camera goes."""
    restore(scene, kept.overrides)
    view = kept.camera
    if scene.camera == view:
        scene.camera = kept.camera_before
    kept.camera = kept.camera_before = None
    kept.overrides = ""
    if view is not None:
        bpy.data.batch_remove([view, view.data])
