"""Which texels of the UV atlas the camouflage may fill, and how much of each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..contract import Vehicle
from .raster.rasterize import rasterize_atlas

SUBSAMPLES = 2  # squared, per texel; partly covered texels only need a rough weight


def texel_coverage(vehicle: Vehicle, size: int) -> NDArray[np.float32]:
    """Paintable share (size, size) in [0, 1] of each texel, row 0 at the top: charts of paint faces times the mask.

    UVs outside [0, 1] lie beyond the map and cover nothing.
    """
    raster = rasterize_atlas(vehicle.uvs[vehicle.paint_faces()], size, SUBSAMPLES)
    rows, columns = raster.pattern.rows, raster.pattern.columns
    hit = raster.whole(size, size).reshape(size, rows, size, columns) >= 0
    charts = hit.mean((1, 3), dtype=np.float32)
    mask = Image.fromarray(vehicle.paint_mask).resize((size, size), Image.Resampling.BOX)
    return charts * (np.asarray(mask, np.float32) / np.float32(255))
