"""A plan, a frame and its images: what several rooms' tests of files write."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rauca_core.contract import Camera, Frame, FramePasses, Plan, Quality, Ring, Weather

SIZE = 32
PLAN = Plan(
    name="p",
    vehicle_name="box",
    atlas_id="abc",
    size=SIZE,
    quality=Quality(4),
    light=True,
    weathers=(Weather("day", 45), Weather("fog", 45, 60, 50)),
    ring=Ring((0.0, 90.0), (10.0, 30.0), (5.0,), jitter_distance=0.1),
    locations=2,
    reference_srgb=(140, 140, 140),
    min_visible=0.5,
    seed=7,
    blender="5.0.1",
)


def a_frame(**changes: Any) -> Frame:
    """The first of the plan's."""
    camera = Camera.look_at(np.array([5.0, 0, 1]), np.zeros(3), 60, SIZE, SIZE)
    day, box = PLAN.weathers[0], (1.0, 2.0, 30.0, 20.0)
    frame = Frame("L00-V000-day", 0, 0, camera, np.eye(4), day, 0.0, 10.0, 5.0, box, 1.0, 3)
    return replace(frame, **changes)


def some_passes(**changes: Any) -> FramePasses:
    """Noise, and light beyond what is stored in B."""
    rng = np.random.default_rng(0)
    grey, color = rng.random((SIZE, SIZE), np.float32), rng.random((3, SIZE, SIZE, 3), np.float32)
    return replace(FramePasses(color[0], grey, grey, grey * 10, color[1], color[2] * 1e6), **changes)
