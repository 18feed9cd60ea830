"""Which texels of the UV atlas the camouflage may fill, and how much of each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..contract import Camera, Vehicle
from .pattern import pattern
from .rasterise import rasterize

SUBSAMPLES = 2  # squared, per texel; partly covered texels only need a rough weight


def texel_coverage(vehicle: Vehicle, size: int) -> NDArray[np.float32]:
    """Paintable share (size, size) in [0, 1] of each texel, row 0 at the top: charts of paint faces times the mask.

    UVs outside [0, 1] lie beyond the map and cover nothing.
    """
    paint = vehicle.paint_faces()
    corners = vehicle.uvs[paint].reshape(-1, 2).astype(np.float64)
    flat = np.stack([corners[:, 0] * size, (1 - corners[:, 1]) * size, np.ones(len(corners))], 1)
    faces = np.arange(len(flat), dtype=np.int32).reshape(-1, 3)
    camera = Camera(np.eye(3), np.eye(3), np.zeros(3), size, size)
    subsamples = pattern(SUBSAMPLES)
    raster = rasterize(flat, faces, camera, pattern=subsamples)
    hit = raster.whole(size, size).reshape(size, subsamples.rows, size, subsamples.columns) >= 0
    charts = hit.mean((1, 3), dtype=np.float32)
    mask = Image.fromarray(vehicle.paint_mask).resize((size, size), Image.Resampling.BOX)
    return charts * (np.asarray(mask, np.float32) / np.float32(255))
