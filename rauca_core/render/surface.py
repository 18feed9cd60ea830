"""What every sample of a view sees of the surface: the face, where on it, and how fast that changes per pixel.

All samplers start here. The same works in the plane of the UV atlas, whose texels are then the pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..runtime.kernels import njit
from .raster.rasterize import Raster

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Surface:
    """Visible samples of the wanted faces. float64: a footprint is the small difference of large numbers.

    Attributes:
        index: (h, w) int32 over the raster's window, the place of a sample in the lists below, or -1.
        faces: (N,) int32 face of each sample.
        barycentrics: (N, 3) perspective-correct, each row sums to 1.
        slopes: (N, 2, 3) change of the barycentrics per *pixel* to the right and down.
        sample_side: side in pixels of the square that one sample which reads the texture stands for.
    """

    index: NDArray[np.int32]
    faces: NDArray[np.int32]
    barycentrics: Array
    slopes: Array
    sample_side: float

    def interpolate(self, corners: NDArray[Any]) -> Array:
        """Values (F, 3, C) at the corners of all faces -> (N, C) at the samples."""
        values: Array = np.einsum("nk,nkc->nc", self.barycentrics, corners[self.faces].astype(np.float64))
        return values

    def differentiate(self, corners: NDArray[Any]) -> Array:
        """Change (N, 2, C) of the interpolated values (F, 3, C) per sample to the right and down."""
        values = np.einsum("nak,nkc->nac", self.slopes, corners[self.faces].astype(np.float64))
        return values * self.sample_side


def find_surface(raster: Raster, wanted: NDArray[np.bool_]) -> Surface:
    """The samples that see a face of ``wanted`` (F,)."""
    rows, columns = np.nonzero(raster.face_ids >= 0)
    seen = wanted[raster.face_ids[rows, columns]]
    rows, columns = rows[seen], columns[seen]
    index = np.full(raster.face_ids.shape, -1, np.int32)
    index[rows, columns] = np.arange(len(rows), dtype=np.int32)
    faces = raster.face_ids[rows, columns]
    barycentrics, slopes = np.empty((len(rows), 3)), np.empty((len(rows), 2, 3))
    _differentiate(raster.points(rows, columns), faces, raster.planes, barycentrics, slopes)
    return Surface(index, faces, barycentrics, slopes, raster.pattern.side)


def mask_at(mask: NDArray[np.uint8], uv: Array) -> NDArray[np.float32]:
    """The paint mask (H, W), bilinear, in [0, 1] at map coordinates (N, 2); beyond the map its edge is repeated."""
    paint = np.empty(len(uv), np.float32)
    _read_mask(mask, uv, paint)
    return paint


@njit(cache=True, nogil=True)
def _read_mask(mask: Any, uv: Any, paint: Any) -> None:
    for n in range(paint.shape[0]):
        paint[n] = bilinear_mask(mask, uv[n, 0], uv[n, 1])


@njit(cache=True, nogil=True)
def bilinear_mask(mask: Any, u: float, v: float) -> float:
    """One value of :func:`mask_at`."""
    height, width = mask.shape
    x = min(max(u * width - 0.5, 0.0), width - 1.0)
    y = min(max((1.0 - v) * height - 0.5, 0.0), height - 1.0)
    left, top = int(x), int(y)
    right, bottom = min(left + 1, width - 1), min(top + 1, height - 1)
    fx, fy = x - left, y - top
    upper = mask[top, left] * (1 - fx) + mask[top, right] * fx
    lower = mask[bottom, left] * (1 - fx) + mask[bottom, right] * fx
    return (upper * (1 - fy) + lower * fy) / 255.0


@njit(cache=True, nogil=True)
def _differentiate(points: Any, faces: Any, planes: Any, barycentrics: Any, slopes: Any) -> None:
    for n in range(faces.shape[0]):
        plane, total = planes[faces[n]], 0.0
        for k in range(3):
            # A sample that a face owns may lie outside it by the rounding of the rasterizer.
            barycentrics[n, k] = max(plane[0, k] * points[n, 0] + plane[1, k] * points[n, 1] + plane[2, k], 0.0)
            total += barycentrics[n, k]
        total = max(total, 1e-300)
        for k in range(3):
            barycentrics[n, k] /= total
        for axis in range(2):
            change = plane[axis, 0] + plane[axis, 1] + plane[axis, 2]
            for k in range(3):
                slopes[n, axis, k] = (plane[axis, k] - barycentrics[n, k] * change) / total
