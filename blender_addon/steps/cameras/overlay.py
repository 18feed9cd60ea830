"""The camera ring drawn over the viewport."""

from __future__ import annotations

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ...scene.ring import RingLines, ring_lines
from ..panel import ViewportOverlay
from .properties import Anchor, RaucaCameras, anchor

# Linear colors and widths in pixels, in drawing order.
STYLES = {
    "circles": ((0.55, 0.75, 1.0, 0.35), 1.0),
    "ranges": ((1.0, 0.62, 0.2, 0.5), 1.0),
    "cameras": ((0.45, 0.72, 1.0, 0.95), 1.5),
    "chosen": ((1.0, 0.75, 0.15, 1.0), 2.5),
}
_drawn: dict[tuple[object, ...], dict[str, gpu.types.GPUBatch]] = {}


def wanted(context: bpy.types.Context) -> bool:
    """Whether this viewport shows the ring: not through a view's camera, whose picture it would clutter."""
    space, settings = context.space_data, context.scene.rauca.cameras
    if not settings.overlay or space is None or space.type != "VIEW_3D" or not space.overlay.show_overlays:
        return False
    return not (settings.looking and space.region_3d.view_perspective == "CAMERA")


def _draw() -> None:
    context = bpy.context
    if not wanted(context):
        return
    settings = context.scene.rauca.cameras
    batches = _batches(context, settings, anchor(context))
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    shader.bind()
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("ALWAYS" if _in_fog(context) else "LESS_EQUAL")
    gpu.state.depth_mask_set(False)
    scale = context.preferences.system.pixel_size
    for name, batch in batches.items():
        color, width = STYLES[name]
        shader.uniform_float("lineWidth", width * scale)
        shader.uniform_float("color", color)
        batch.draw(shader)
    gpu.state.depth_mask_set(True)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


def _in_fog(context: bpy.types.Context) -> bool:
    """Whether the fog's box is in the depths of this view: Cycles puts it there as if it were solid."""
    box = context.scene.rauca.weather.shown.fog
    return box is not None and not box.hide_viewport and context.space_data.shading.type == "RENDERED"


def _batches(context: bpy.types.Context, settings: RaucaCameras, around: Anchor) -> dict[str, gpu.types.GPUBatch]:
    """The lines on the graphics card; made anew only when something about them has changed."""
    shots, place, chosen = settings.shots(context), context.scene.rauca.weather.place - 1, settings.chosen()
    key = (shots, place, chosen, around.vehicle_to_world.tobytes(), around.center.tobytes())
    if key not in _drawn:
        _drawn.clear()
        lines = ring_lines(shots, place, chosen, around.vehicle_to_world, around.center)
        _drawn[key] = _on_card(lines)
    return _drawn[key]


def _on_card(lines: RingLines) -> dict[str, gpu.types.GPUBatch]:
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    batches = {}
    for name in STYLES:
        ends = np.ascontiguousarray(getattr(lines, name)).reshape(-1, 3)
        if len(ends):
            batches[name] = batch_for_shader(shader, "LINES", {"pos": ends})
    return batches


_ring = ViewportOverlay(_draw, "POST_VIEW")
register = _ring.register


def unregister() -> None:
    _ring.unregister()
    _drawn.clear()
