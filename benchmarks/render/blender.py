"""Cycles in a child process: what Blender itself sees of a vehicle's paint, from many cameras in one start."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.child import run_child
from rauca_core.contract import Camera, Progress, Vehicle
from rauca_core.runtime.blender import require_bpy

SCRIPT = Path(__file__).with_name("cycles_view.py")
Image = NDArray[np.float32]


class Job(NamedTuple):
    """One render: ``coverage``, ``premultiplied`` or ``uv``, by the camera of that number."""

    what: str
    camera: int
    samples: int


def render_jobs(
    vehicle: Vehicle,
    cameras: Sequence[Camera],
    uv_map_linear: Image,
    jobs: Sequence[Job],
    progress: Callable[[Progress], None] = lambda news: None,
) -> list[Image]:
    """Render ``jobs``, an image (H, W, 3) linear each; see `cycles_view.py` for what they show.

    Args:
        cameras: square images, all of one size.
        uv_map_linear: (size, size, 3).

    Raises:
        RaucaError: Blender is missing, or died.
    """
    require_bpy("leave this part out with --no-blender")
    with tempfile.TemporaryDirectory(prefix="rauca-bench-") as temporary:
        source, target = Path(temporary) / "views.npz", Path(temporary) / "rendered.npz"
        np.savez(
            source,
            positions=vehicle.positions,
            triangles=vehicle.triangles,
            uvs=vehicle.uvs,
            paint=vehicle.paint_faces(),
            mask=vehicle.paint_mask,
            uv_map_linear=uv_map_linear,
            K=np.stack([c.K for c in cameras]),
            R=np.stack([c.R for c in cameras]),
            t=np.stack([c.t for c in cameras]),
            size=cameras[0].width,
            jobs=json.dumps(jobs),
        )
        run_child("render", [sys.executable, "-P", str(SCRIPT), str(source), str(target)], progress)
        with np.load(target) as archive:
            return [archive[str(i)] for i in range(len(jobs))]
