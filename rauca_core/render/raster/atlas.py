"""The UV atlas seen as an image: the plane in which texels are the pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...contract import Camera
from .pattern import pattern
from .rasterize import Raster, rasterize


def rasterize_atlas(uvs: NDArray[np.floating], size: int, samples: int = 1) -> Raster:
    """See the UV atlas as an image of ``size`` x ``size`` pixels, row 0 at the top, lowest face first on overlaps.

    Args:
        uvs: (F, 3, 2) per corner, u right, v up; what lies outside [0, 1] lies outside the image.
        size: side of the map, texels.
        samples: a texel has about ``samples`` x ``samples`` subsamples; one means its center.
    """
    corners = uvs.reshape(-1, 2).astype(np.float64)
    flat = np.stack([corners[:, 0] * size, (1 - corners[:, 1]) * size, np.ones(len(corners))], 1)
    camera = Camera(np.eye(3), np.eye(3), np.zeros(3), size, size)
    return rasterize(flat, np.arange(len(flat), dtype=np.int32).reshape(-1, 3), camera, pattern=pattern(samples))
