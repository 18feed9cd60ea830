"""The camera ring drawn over the viewport."""

from __future__ import annotations

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ...scene.ring import RingLines, ring_lines
from ..panel import ViewportOverlay
from .properties import anchor

# Linear colors and widths in pixels, in drawing order.
STYLES = {
    "circles": ((0.55, 0.75, 1.0, 0.35), 1.0),
    "ranges": ((1.0, 0.62, 0.2, 0.5), 1.0),
    "cameras": ((0.45, 0.72, 1.0, 0.95), 1.5),
    "chosen": ((1.0, 0.75, 0.15, 1.0), 2.5),
}


def _draw(context: bpy.types.Context) -> None:
    settings = context.scene.rauca.cameras
    around, place = anchor(context), context.scene.rauca.weather.place - 1
    if not settings.overlay or not around.found:
        return
    if settings.looking and context.region_data.view_perspective == "CAMERA":
        return  # the ring would clutter the view's picture
    shots, chosen, pose, center = settings.shots(), settings.chosen(), around.vehicle_to_world, around.center
    key = (shots, place, chosen, pose.tobytes(), center.tobytes())
    batches = _ring.kept(key, lambda: _on_card(ring_lines(shots, place, chosen, pose, center)))
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


def _on_card(lines: RingLines) -> dict[str, gpu.types.GPUBatch]:
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    batches = {}
    for name in STYLES:
        ends = np.ascontiguousarray(getattr(lines, name)).reshape(-1, 3)
        if len(ends):
            batches[name] = batch_for_shader(shader, "LINES", {"pos": ends})
    return batches


_ring = ViewportOverlay(_draw, "POST_VIEW")
register, unregister = _ring.register, _ring.unregister
