"""Marked points over the photograph: where each was marked, and a line from there to where the camera sees it."""

from __future__ import annotations

import bpy
from bpy_extras.view3d_utils import location_3d_to_region_2d

from ..camouflage.detection_overlay import COLORS, LINE_PX, draw_label, draw_lines, frame_on_screen, place_in_frame
from ..panel import ViewportOverlay
from .properties import standing

ARM_PX = 6.0  # of a mark's cross


def _draw(context: bpy.types.Context) -> None:
    settings, render = context.scene.rauca.photograph, context.scene.render
    looking = settings.camera is not None and context.scene.camera == settings.camera
    found = standing(context) if looking and settings.marks else None
    if found is None:
        return
    through = context.region_data.view_perspective == "CAMERA"
    frame = frame_on_screen(context.scene, context.region, context.region_data) if through else None
    points, pixels = settings.marked()
    to_world, scale = found.to_world, context.preferences.system.ui_scale
    for number, (point, pixel) in enumerate(zip(points, pixels, strict=True)):
        color = COLORS[number % len(COLORS)]
        seen = location_3d_to_region_2d(context.region, context.region_data, (to_world @ [*point, 1.0])[:3])
        ends = _cross(seen, scale) if seen is not None else []
        if frame is not None:
            at = place_in_frame(frame, pixel[0] / render.resolution_x, pixel[1] / render.resolution_y)
            ends += _cross(at, scale) + ([tuple(seen), at] if seen is not None else [])
            beside = (at[0] + ARM_PX * scale, at[1] + ARM_PX * scale)  # the marked place itself stays to be seen
            draw_label(str(number + 1), beside, color, scale, [])
        if ends:
            draw_lines(ends, color, LINE_PX * scale)


def _cross(at: tuple[float, float], scale: float) -> list[tuple[float, float]]:
    """Ends of two lines that cross at a place of the region."""
    arm = ARM_PX * scale
    return [(at[0] + x * arm, at[1] + y * arm) for x, y in ((-1, -1), (1, 1), (-1, 1), (1, -1))]


_marks = ViewportOverlay(_draw, "POST_PIXEL")
register, unregister = _marks.register, _marks.unregister
