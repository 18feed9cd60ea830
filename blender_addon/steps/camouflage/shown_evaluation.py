"""The evaluation that a scene shows: read once, beside the window, and looked up by the camera's view."""

from __future__ import annotations

import threading
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.object_utils import world_to_camera_view
from numpy.typing import NDArray

from ...core import contract
from ...scene.coating import Coat
from .evaluation import NORMAL, RESULTS, STUDY, EvaluatedFrame, Views, read_evaluated_frames

REDRAW_S = 0.1

_read: dict[tuple[str, float], Views | str | None] = {}  # None: is being read


def loaded(study: str) -> Views | None:
    """The evaluation in a folder; None while it is being read, or cannot be."""
    found = ask(study)
    return found if isinstance(found, Views) else None


def ask(study: str) -> Views | str | None:
    """The evaluation in a folder, or why there is none; None while it is being read, which this call begins."""
    if not study:
        return None
    key = _key(study)
    if key not in _read:
        _read[key] = None
        threading.Thread(target=_load, args=(key,), daemon=True).start()  # a second's reading, and no bpy in it
        if not bpy.app.background and not bpy.app.timers.is_registered(_redraw_when_read):
            bpy.app.timers.register(_redraw_when_read, first_interval=REDRAW_S)
    return _read[key]


def load_now(study: str) -> Views:
    """The evaluation in a folder, at once; raises :class:`RaucaError` if there is none, or it is damaged."""
    key = _key(study)
    found = _read.get(key)
    if not isinstance(found, Views):
        found = _read[key] = Views(read_evaluated_frames(Path(key[0])))
    return found


def vehicle_to_world(scene: bpy.types.Scene) -> NDArray[np.float64] | None:
    """Where the camouflaged vehicle stands now, (4, 4); None if it is gone."""
    settings = scene.rauca.camouflage
    if settings.coat is None or settings.anchor is None:
        return None
    return np.array(settings.anchor.matrix_world) @ np.array(settings.vehicle_to_anchor).reshape(4, 4)


def same_view(scene: bpy.types.Scene, views: Views) -> list[EvaluatedFrame]:
    """The evaluated frames that show the vehicle as the scene's camera does; the chosen one first."""
    pose = vehicle_to_world(scene)
    if pose is None or scene.camera is None or scene.camera.type != "CAMERA":
        return []
    found = views.same(*_corners(scene, pose))
    return sorted(found, key=lambda evaluated: evaluated.frame != scene.rauca.camouflage.frame)


def nearest(scene: bpy.types.Scene, views: Views) -> EvaluatedFrame | None:
    """The evaluated frame whose view is closest to the scene's camera; the first one without a camera."""
    pose = vehicle_to_world(scene)
    if pose is None or not views.evaluated_frames:
        return None
    if scene.camera is None:
        return views.evaluated_frames[0]
    eye = np.linalg.inv(pose) @ np.array([*scene.camera.matrix_world.translation, 1.0])
    return min(views.evaluated_frames, key=lambda evaluated: float(np.linalg.norm(evaluated.camera.position - eye[:3])))


def paint_of(scene: bpy.types.Scene) -> str:
    """What the vehicle wears, as evaluations name it."""
    tree = scene.rauca.camouflage.coat
    if tree is None or Coat(tree).shown == "ORIGINAL":
        return NORMAL
    return str(tree.get("rauca_camouflage", ""))


def show_picture(scene: bpy.types.Scene) -> None:
    """Lay what the detectors saw over the evaluated view, in the paint that shows; nothing where there is no file."""
    settings = scene.rauca.camouflage
    if settings.camera is None:
        return
    lens, views = settings.camera.data, loaded(settings.study)
    seen = same_view(scene, views)[:1] if views is not None and settings.picture else []
    file = seen[0].pictures.get(paint_of(scene)) if seen else None
    old = take_pictures(lens)
    if file is not None and file.is_file():
        entry = lens.background_images.new()
        entry.image = bpy.data.images.load(str(file), check_existing=True)
        entry.alpha, entry.display_depth, entry.frame_method = 1.0, "FRONT", "STRETCH"
    lens.show_background_images = bool(lens.background_images)
    bpy.data.batch_remove([image for image in old if image.users == 0])


def take_pictures(lens: bpy.types.Camera) -> list[bpy.types.Image]:
    """Take all pictures off a camera, and give back what lay there."""
    found = {entry.image for entry in lens.background_images if entry.image is not None}
    for entry in lens.background_images:
        entry.image = None  # clearing alone would leave the image one user too many
    lens.background_images.clear()
    return list(found)


def _corners(scene: bpy.types.Scene, pose: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corners of the anchor's box in the vehicle's frame (8, 3), and where the camera shows them (8, 2)."""
    anchor = scene.rauca.camouflage.anchor
    world = [anchor.matrix_world @ type(anchor.location)(corner) for corner in anchor.bound_box]
    seen = np.array([world_to_camera_view(scene, scene.camera, corner) for corner in world])
    seen[seen[:, 2] <= 0] = np.inf
    local = np.c_[np.array(world), np.ones(8)] @ np.linalg.inv(pose).T
    return local[:, :3], np.stack([seen[:, 0], 1 - seen[:, 1]], axis=1)


def _key(study: str) -> tuple[str, float]:
    folder = bpy.path.abspath(study)
    path = next((p for name in (STUDY, RESULTS) if (p := Path(folder) / name).is_file()), None)
    return folder, path.stat().st_mtime if path is not None else 0.0


def _load(key: tuple[str, float]) -> None:
    try:
        _read[key] = Views(read_evaluated_frames(Path(key[0])))
    except contract.RaucaError as error:
        _read[key] = str(error)
    except Exception as error:  # the panel tells it; a thread's would vanish
        _read[key] = f"{key[0]}: cannot be read ({error})"


def _redraw_when_read() -> float | None:
    if None in _read.values():
        return REDRAW_S
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
    return None
