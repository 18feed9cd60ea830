"""Looking through a view of the data set in the artist's scene; his own camera is left alone."""

from __future__ import annotations

from typing import Protocol

import bpy

from ..core import contract
from .camera import aim, new_holder
from .lent import give_back, lend


class Looking(Protocol):
    """Where a scene keeps the view's camera and what it replaced; a property group.

    Attributes:
        camera: the view's; None before the first look.
        camera_before: the artist's own; None if there was none.
        loans: see `lent.py`.
    """

    camera: bpy.types.Object | None
    camera_before: bpy.types.Object | None
    loans: str


def look(scene: bpy.types.Scene, kept: Looking, camera: contract.Camera) -> None:
    """Make a view's camera the scene's, its picture as large as the data set's."""
    if kept.camera is None:
        kept.camera = new_holder()
        kept.camera.hide_select = True
    if kept.camera.name not in scene.objects:
        scene.collection.objects.link(kept.camera)
    if scene.camera != kept.camera:
        kept.camera_before, scene.camera = scene.camera, kept.camera
    aim(kept.camera, camera)
    size = {"resolution_x": camera.width, "resolution_y": camera.height, "resolution_percentage": 100}
    square = {"pixel_aspect_x": 1.0, "pixel_aspect_y": 1.0}
    kept.loans = lend(scene, kept.loans, {f"render.{name}": value for name, value in (size | square).items()})


def leave(scene: bpy.types.Scene, kept: Looking) -> None:
    """Give the scene its own camera and picture size back; the view's camera goes."""
    give_back(scene, kept.loans)
    view = kept.camera
    if scene.camera == view:
        scene.camera = kept.camera_before
    kept.camera = kept.camera_before = None
    kept.loans = ""
    if view is not None:
        bpy.data.batch_remove([view, view.data])
