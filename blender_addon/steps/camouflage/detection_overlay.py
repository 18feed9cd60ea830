"""Detectors' boxes over the camera's view."""

from __future__ import annotations

from collections.abc import Sequence

import blf
import bpy
import gpu
import numpy as np
from bpy.app.translations import pgettext_iface as iface
from bpy_extras.view3d_utils import location_3d_to_region_2d
from gpu_extras.batch import batch_for_shader
from numpy.typing import NDArray

from ..panel import ViewportOverlay
from .evaluation import Detection, EvaluatedFrame
from .shown_evaluation import loaded, paint_of, same_view

# Okabe and Ito's colors, told apart by color-blind people too; then lighter ones.
COLORS = (
    *((0.90, 0.62, 0.0), (0.34, 0.71, 0.91), (0.0, 0.75, 0.5), (0.94, 0.89, 0.26), (0.25, 0.55, 0.95)),
    *((0.95, 0.45, 0.1), (0.85, 0.5, 0.7), (0.75, 0.75, 0.75), (0.6, 0.9, 0.6), (0.8, 0.65, 0.95)),
)
FONT, TEXT_PX, LINE_PX = 0, 11, 2.0
Rectangle = tuple[float, float, float, float]  # left, bottom, right, top


def shown_detections(scene: bpy.types.Scene, evaluated: EvaluatedFrame) -> list[tuple[str, Detection]]:
    """(detector, detection) of the boxes to draw, best first."""
    settings, paint = scene.rauca.camouflage, paint_of(scene)
    chosen = [name for name in evaluated.evaluation.detectors if settings.detector in ("ALL", name)]
    found = [(name, box) for name in chosen for box in evaluated.evaluation.of(evaluated, paint, name)]
    return sorted((x for x in found if x[1].score >= settings.least_score), key=lambda x: -x[1].score)


def unfound(scene: bpy.types.Scene, evaluated: EvaluatedFrame) -> list[str]:
    """The chosen detectors that have no box to draw in this view, if the evaluation has the paint that shows."""
    if paint_of(scene) not in evaluated.evaluation.paints:
        return []
    found = {name for name, _ in shown_detections(scene, evaluated)}
    chosen = scene.rauca.camouflage.detector
    return [name for name in evaluated.evaluation.detectors if chosen in ("ALL", name) and name not in found]


def _draw(context: bpy.types.Context) -> None:
    settings = context.scene.rauca.camouflage
    if not settings.boxes or context.region_data.view_perspective != "CAMERA":
        return
    views = loaded(settings.study)
    evaluated_frames = same_view(context.scene, views) if views is not None else []
    frame = frame_on_screen(context.scene, context.region, context.region_data) if evaluated_frames else None
    if frame is None:
        return
    evaluated = evaluated_frames[0]
    size = np.array([evaluated.camera.width, evaluated.camera.height] * 2)
    scale = context.preferences.system.ui_scale
    taken: list[Rectangle] = []
    for detector, detection in shown_detections(context.scene, evaluated):
        left, top, right, bottom = np.array(detection.box) / size
        (x0, y1), (x1, y0) = place_in_frame(frame, left, top), place_in_frame(frame, right, bottom)
        color = COLORS[evaluated.evaluation.detectors.index(detector) % len(COLORS)]  # the same in every view
        _outline([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], color, LINE_PX * scale)
        draw_label(f"{detector}  {detection.score:.2f}", (x0, y1), color, scale, taken)
    for detector in unfound(context.scene, evaluated):
        color = COLORS[evaluated.evaluation.detectors.index(detector) % len(COLORS)]
        draw_label(f"{detector}  {iface('not found')}", place_in_frame(frame, 0.0, 1.0), color, scale, taken)


def frame_on_screen(
    scene: bpy.types.Scene, region: bpy.types.Region, view: bpy.types.RegionView3D
) -> NDArray[np.float64] | None:
    """Left, bottom, right, top of the camera's frame in a region that looks through it, pixels."""
    corners = [scene.camera.matrix_world @ corner for corner in scene.camera.data.view_frame(scene=scene)]
    places = [location_3d_to_region_2d(region, view, corner) for corner in corners]
    if any(place is None for place in places):
        return None
    points = np.array(places)
    return np.concatenate([points.min(axis=0), points.max(axis=0)])


def place_in_frame(frame: NDArray[np.float64], across: float, down: float) -> tuple[float, float]:
    """A place of the region; ``across`` and ``down`` the camera's frame, 0 to 1."""
    left, bottom, right, top = frame
    return left + across * (right - left), top - down * (top - bottom)


def _outline(corners: Sequence[tuple[float, float]], color: tuple[float, float, float], width: float) -> None:
    draw_lines([point for i in range(4) for point in (corners[i], corners[(i + 1) % 4])], color, width)


def draw_lines(ends: Sequence[tuple[float, float]], color: tuple[float, float, float], width: float) -> None:
    """Lines between every two places of the region; pixels."""
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    batch = batch_for_shader(shader, "LINES", {"pos": [(x, y, 0.0) for x, y in ends]})
    gpu.state.blend_set("ALPHA")
    shader.bind()
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    shader.uniform_float("lineWidth", width)
    shader.uniform_float("color", (*color, 1.0))
    batch.draw(shader)
    gpu.state.blend_set("NONE")


def draw_label(
    text: str, place: tuple[float, float], color: tuple[float, float, float], scale: float, taken: list[Rectangle]
) -> None:
    """Dark text on the detector's color, on top of its box or wherever above it no other label lies."""
    blf.size(FONT, TEXT_PX * scale)
    pad, height = 4 * scale, (TEXT_PX + 7) * scale
    x, y = place[0] - LINE_PX * scale / 2, place[1]
    end = x + blf.dimensions(FONT, text)[0] + 2 * pad
    while any(x < right and end > left and y < top and y + height > low for left, low, right, top in taken):
        y += height
    taken.append((x, y, end, y + height))
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    corners = [(x, y), (end, y), (end, y + height), (x, y + height)]
    batch = batch_for_shader(shader, "TRI_FAN", {"pos": corners})
    shader.bind()
    shader.uniform_float("color", (*color, 1.0))
    batch.draw(shader)
    blf.color(FONT, 0.05, 0.05, 0.05, 1.0)
    blf.position(FONT, x + pad, y + 5 * scale, 0)
    blf.draw(FONT, text)


_boxes = ViewportOverlay(_draw, "POST_PIXEL")
register, unregister = _boxes.register, _boxes.unregister
