"""Marking by mouse: a click on the vehicle, then one on the same point of the photograph, pair after pair."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import bpy
import numpy as np
from bpy.app.translations import pgettext_rpt as rpt
from bpy_extras.view3d_utils import region_2d_to_origin_3d, region_2d_to_vector_3d
from mathutils import Vector
from numpy.typing import NDArray

from ...core import contract
from ..camouflage.detection_overlay import frame_on_screen
from ..operator import NO_UNDO, NOT_OBJECT_MODE, Obstacle, RaucaOperator, covered, see_through_camera
from .properties import NO_PHOTOGRAPH, NOT_STANDING, SEE_BOTH, RaucaPhotograph, standing

PAST_M = 1e-4  # behind a surface that is not the vehicle's the ray goes on
NO_WINDOW = Obstacle("Marking needs the mouse, in a 3D view", lambda context: bpy.app.background)
NO_MARKS = Obstacle("No point is marked", lambda context: not context.scene.rauca.photograph.marks)
MARKING = Obstacle("Points are being marked; Esc ends", lambda context: RAUCA_OT_mark_points.under_way)
MOST_SURFACES = 64  # before the vehicle: fog, the street's trees


def vehicle_point(context: bpy.types.Context, origin: Vector, way: Vector) -> NDArray[np.float64] | None:
    """Where a ray of the world meets the vehicle of step 1 first, (3,) metres in the vehicle's own frame; or None."""
    found = standing(context)
    if found is None:
        return None
    parts = set(found.objects)
    parts |= {part for thing in parts if thing.instance_collection for part in thing.instance_collection.all_objects}
    graph = context.evaluated_depsgraph_get()
    for _ in range(MOST_SURFACES):
        met, place, _, _, thing, _ = context.scene.ray_cast(graph, origin, way)
        if not met:
            return None
        if thing.original in parts:
            local = np.linalg.inv(found.to_world) @ np.array([*place, 1.0])
            return local[:3]
        origin = place + way * PAST_M
    return None


def pixel_at(frame: Sequence[float], size: tuple[int, int], x: float, y: float) -> tuple[float, float] | None:
    """The photograph's pixel under a place of the region; None beside it.

    Args:
        frame: left, bottom, right, top of the photograph in the region.
        size: its width and height, pixels.
    """
    left, bottom, right, top = frame
    across, down = (x - left) / (right - left), (top - y) / (top - bottom)
    return (across * size[0], down * size[1]) if 0 <= across <= 1 and 0 <= down <= 1 else None


def add_mark(settings: RaucaPhotograph, point: Sequence[float], pixel: Sequence[float]) -> None:
    """Keep a pair: the vehicle's point (3,), metres in its own frame, and the photograph's pixel (2,)."""
    mark = settings.marks.add()
    mark.vehicle_m, mark.pixel = point, pixel


def window_under(area: bpy.types.Area, x: int, y: int) -> bpy.types.Region | None:
    """The 3D view's own region under the mouse; None where a sidebar or header lies over it, or outside."""
    under = [region for region in area.regions if region.width > 1 and region.height > 1 and _holds(region, x, y)]
    return under[0] if under and all(region.type == "WINDOW" for region in under) else None


def _holds(region: bpy.types.Region, x: int, y: int) -> bool:
    return 0 <= x - region.x < region.width and 0 <= y - region.y < region.height


class RAUCA_OT_mark_points(RaucaOperator, bpy.types.Operator):
    """Click on a point of the vehicle, then on the same point of the photograph, and so on; Esc ends"""

    bl_label = "Mark Points"
    bl_options = NO_UNDO  # every pair is a step of undo by itself
    under_way: ClassVar[bool] = False
    obstacles = (NO_PHOTOGRAPH, NOT_STANDING, NOT_OBJECT_MODE, NO_WINDOW, covered("photograph"), MARKING)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        settings = context.scene.rauca.photograph
        try:
            if settings.camera is None:
                settings.look(context, settings.first_look())
                settings.lay(settings.path(), SEE_BOTH)
                see_through_camera(context, True)
        except contract.RaucaError as error:
            return self.refuse(error)
        self._point: NDArray[np.float64] | None = None
        RAUCA_OT_mark_points.under_way = True
        self._ask(context)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        settings = context.scene.rauca.photograph
        if event.type in {"ESC", "RET"} or settings.camera is None or context.area is None:
            self.cancel(context)
            return {"FINISHED"}
        region = window_under(context.area, event.mouse_x, event.mouse_y)
        if event.type != "LEFTMOUSE" or event.value != "PRESS" or region is None:
            return {"PASS_THROUGH"}  # the view is turned and zoomed as usual
        try:
            self._click(context, region, event.mouse_x - region.x, event.mouse_y - region.y)
        except contract.RaucaError as error:
            self.refuse(error)
        self._ask(context)
        return {"RUNNING_MODAL"}

    def _click(self, context: bpy.types.Context, region: bpy.types.Region, x: float, y: float) -> None:
        """Take half a pair; raises :class:`RaucaError` where there is nothing to mark."""
        view, settings = context.space_data.region_3d, context.scene.rauca.photograph
        if self._point is None:
            origin, way = (f(region, view, (x, y)) for f in (region_2d_to_origin_3d, region_2d_to_vector_3d))
            self._point = vehicle_point(context, origin, way)
            if self._point is None:
                raise contract.RaucaError("No part of the vehicle is there; click on the vehicle")
            return
        frame, size = frame_on_screen(context.scene, region, view), context.scene.render
        at = None
        if view.view_perspective == "CAMERA" and frame is not None:
            at = pixel_at(frame.tolist(), (size.resolution_x, size.resolution_y), x, y)
        if at is None:
            raise contract.RaucaError("The photograph is not there; click into it")
        add_mark(settings, self._point.tolist(), at)
        self._point = None
        bpy.ops.ed.undo_push(message="Rauca: Mark Point")

    def _ask(self, context: bpy.types.Context) -> None:
        """Say what to click on next; the photograph alone shows while its point is asked for."""
        settings, wanted = context.scene.rauca.photograph, self._point is not None
        if wanted:
            see_through_camera(context, True)
        settings.fade(1.0 if wanted else SEE_BOTH)
        words = rpt("Now click on the same point of the photograph; Esc ends")
        if not wanted:
            words = rpt("Click on a point of the vehicle, number {number}; Esc ends")
        words = words.format(number=len(settings.marks) + 1)
        context.workspace.status_text_set(words)
        context.area.header_text_set(words)  # above the view, where it is read
        context.area.tag_redraw()

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender calls this too: another file is loaded, or the window closes."""
        RAUCA_OT_mark_points.under_way = False
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        if context.area is not None:
            context.area.header_text_set(None)
        context.scene.rauca.photograph.fade(SEE_BOTH)


class RAUCA_OT_remove_marks(RaucaOperator, bpy.types.Operator):
    """Take marked points back"""

    bl_label = "Remove Marks"
    obstacles = (NO_MARKS,)
    which: bpy.props.EnumProperty(
        name="Remove",
        items=[("LAST", "Last", "Take the last marked point back"), ("ALL", "All", "Take all marked points back")],
        options={"SKIP_SAVE"},
    )

    def work(self, context: bpy.types.Context) -> None:
        marks = context.scene.rauca.photograph.marks
        for _ in range(len(marks) if self.which == "ALL" else 1):
            marks.remove(len(marks) - 1)
        context.scene.rauca.photograph.missed_px = -1.0
