"""Settings of the photograph, kept in the scene: the picture, the camera that looks at it, and marked points."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import bpy
import numpy as np
from bpy.app.translations import pgettext_rpt as rpt
from numpy.typing import NDArray

from ...core import contract
from ...scene import camera
from ..cameras.properties import anchor
from ..camouflage.painted_vehicle import ATLAS_KEY
from ..camouflage.shown_evaluation import take_pictures
from ..operator import Obstacle
from ..panel import angle, folder_setting

FIRST_EYE_M, FIRST_MIDDLE_M = np.array([5.0, 4.0, 1.8]), np.array([0.0, 0.0, 0.7])  # before a car's front left
SEE_BOTH = 0.5  # opacity of the photograph before a vehicle that is to be pulled onto it


def _widened(self: RaucaPhotograph, context: bpy.types.Context) -> None:
    """Another field of view: the camera that is looked through gets it."""
    if self.camera is not None:
        self.camera.data.angle = self.fov


def _file_setting(name: str, tip: str) -> bpy.props._PropertyDeferred:
    return bpy.props.StringProperty(name=name, description=tip, subtype="FILE_PATH")


class Standing(NamedTuple):
    """Where the vehicle of step 1 stands: its objects, and the rigid (4, 4) transform of its own frame to the world."""

    objects: list[bpy.types.Object]
    to_world: NDArray[np.float64]


def standing(context: bpy.types.Context) -> Standing | None:
    """The vehicle in this scene; None where it is not. One that is a file is the object that step 6 placed for it."""
    chosen = context.scene.rauca.vehicle
    if chosen.origin == "FILE":
        placed = [thing for thing in context.scene.objects if ATLAS_KEY in thing][:1]
        return Standing(placed, np.array(placed[0].matrix_world)) if placed else None
    found = anchor(context)
    return Standing(list(chosen.objects(context)), found.vehicle_to_world) if found.found else None


NOT_STANDING = Obstacle(
    "The vehicle is not in this scene: pick it in step 1, or apply a camouflage to it in step 6",
    lambda context: standing(context) is None,
)

NO_PHOTOGRAPH = Obstacle("Choose a photograph first", lambda context: not context.scene.rauca.photograph.file)


def vehicle_to_world(context: bpy.types.Context) -> NDArray[np.float64]:
    """(4, 4); raises :class:`RaucaError` where the vehicle is not in this scene."""
    found = standing(context)
    if found is None:
        raise contract.RaucaError(NOT_STANDING.words)
    return found.to_world


class RaucaMark(bpy.types.PropertyGroup):
    """One point of the vehicle and where the photograph shows it."""

    vehicle_m: bpy.props.FloatVectorProperty(size=3, options={"HIDDEN"})  # in the vehicle's own frame, metres
    pixel: bpy.props.FloatVectorProperty(size=2, options={"HIDDEN"})  # the top-left pixel's center is (0.5, 0.5)


class RaucaPhotograph(bpy.types.PropertyGroup):
    """``camera``, ``camera_before`` and ``overrides`` are there while it is looked at.

    ``missed_px`` is how far the fit of the marks was off, root mean square; negative while there is none.
    """

    file: _file_setting("Photograph", "A picture that shows the whole vehicle of step 1")
    mask: _file_setting("Silhouette", "A grey picture of the same size, white where the vehicle is seen; may be empty")
    folder: folder_setting("Folder", "The marks, the fitted photograph and its camouflages are written here")
    fov: angle("Field of View", "Of the camera, over the photograph's longer side", 50, 4, 120, update=_widened)
    marks: bpy.props.CollectionProperty(type=RaucaMark, options={"HIDDEN"})
    missed_px: bpy.props.FloatProperty(default=-1.0, options={"HIDDEN"})
    camera: bpy.props.PointerProperty(type=bpy.types.Object)
    camera_before: bpy.props.PointerProperty(type=bpy.types.Object)
    overrides: bpy.props.StringProperty(options={"HIDDEN"})

    def path(self) -> Path:
        """The photograph's file."""
        return Path(bpy.path.abspath(self.file))

    def size(self) -> tuple[int, int]:
        """Width and height of the photograph, pixels; raises :class:`RaucaError` where there is none."""
        path = self.path()
        image = _load(path)
        width, height = image.size
        if not image.users:
            bpy.data.images.remove(image)
        if not width or not height:
            raise contract.RaucaError(rpt("{file}: is no picture; choose a PNG or JPEG").format(file=path.name))
        return width, height

    def look(self, context: bpy.types.Context, seen: contract.Camera) -> None:
        """Look through a camera of the vehicle's own frame, whose size is the photograph's."""
        camera.look(context.scene, self, seen.relative_to(np.linalg.inv(vehicle_to_world(context))))
        self.camera.hide_select = False  # it may be pulled
        self["fov"] = self.camera.data.angle  # as it is, not set anew
        context.view_layer.update()

    def present(self, context: bpy.types.Context) -> contract.Camera:
        """The camera as it stands now, in the vehicle's own frame."""
        seen = camera.seen_by(self.camera, *self.size())
        return seen.relative_to(vehicle_to_world(context))

    def first_look(self) -> contract.Camera:
        """A camera before the vehicle, to the left of its front, to begin with."""
        width, height = self.size()
        across = 2 * math.atan(math.tan(self.fov / 2) * width / max(width, height))
        return contract.Camera.look_at(FIRST_EYE_M, FIRST_MIDDLE_M, math.degrees(across), width, height)

    def lay(self, path: Path, opacity: float) -> None:
        """Lay a picture before the vehicle in the camera's view, in place of the one that lies there."""
        lens = self.camera.data
        old = take_pictures(lens)
        entry = lens.background_images.new()
        entry.image = bpy.data.images.load(str(path), check_existing=True)
        entry.image.reload()  # composed anew under the same name
        # Of a picture made square by grey bars, the middle.
        entry.alpha, entry.display_depth, entry.frame_method = opacity, "FRONT", "CROP"
        lens.show_background_images = True
        bpy.data.batch_remove([image for image in old if image.users == 0])

    def fade(self, opacity: float) -> None:
        """Show more or less of the vehicle behind what lies in the camera's view."""
        for entry in self.camera.data.background_images if self.camera is not None else ():
            entry.alpha = opacity

    def marked(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Marked points: in the vehicle's frame (N, 3), metres, and in the photograph (N, 2), pixels."""
        points = np.array([mark.vehicle_m for mark in self.marks], float).reshape(-1, 3)
        return points, np.array([mark.pixel for mark in self.marks], float).reshape(-1, 2)


def _load(path: Path) -> bpy.types.Image:
    try:
        return bpy.data.images.load(str(path), check_existing=True)
    except RuntimeError:
        raise contract.RaucaError(rpt("{file}: cannot be read; choose a picture").format(file=path.name)) from None
