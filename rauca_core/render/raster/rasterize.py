"""Which face owns each subsample of an image: a z-buffer that is exact about edges.

Vertices and samples are snapped to one fixed-point lattice and edges follow the top-left rule, so a sample on a shared
edge belongs to exactly one face. Depth and barycentrics come from the unsnapped triangle in homogeneous coordinates,
float64: float32 depth could not separate surfaces a micrometre apart at ten metres.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...contract import Camera, RaucaError
from ...runtime.kernels import njit
from .pattern import Pattern
from .pattern import pattern as pattern_of
from .scanline import draw
from .triangles import LIMIT, MAX_SIDE, Screen

Array = NDArray[np.float64]

TINY = 1e-200
NEAR_M = 0.02  # the near plane of the cameras that Blender renders with


@dataclass(frozen=True, eq=False)
class Raster:
    """Visibility of a mesh at the subsamples of an image.

    Sample (row r, column c) of the window lies at pixel coordinates
    ``x = (x0 + c + shifts[(y0 + r) % rows]) / columns - margin`` and ``y = (y0 + r + 0.5) / rows - margin``.

    Attributes:
        face_ids: (h, w) int32 face seen by each sample of the window, -1 for none.
        x0, y0: the window's first column and row in the image's samples, margin included.
        pattern: where the samples of a pixel lie: ``columns``, ``rows`` and ``shifts``.
        margin: pixels rasterized around the image.
        positions, triangles: of the mesh.
        matrix: (3, 4) float64, from the world to homogeneous pixel coordinates.
    """

    face_ids: NDArray[np.int32]
    x0: int
    y0: int
    pattern: Pattern
    margin: int
    positions: NDArray[np.floating]
    triangles: NDArray[np.int32]
    matrix: Array

    @cached_property
    def planes(self) -> Array:
        """(F, 3, 3) float64: ``(x, y, 1) @ planes[face]`` at pixel coordinates (x, y) is barycentrics / depth.

        Zeros for faces that no sample sees.
        """
        planes = np.zeros((len(self.triangles), 3, 3))
        _invert_seen(self.face_ids, self.positions, self.triangles, self.matrix, planes)
        return planes

    def whole(self, width: int, height: int) -> NDArray[np.int32]:
        """Face ids (height * rows, width * columns) of an image's own samples, -1 for none."""
        rows, columns = self.pattern.rows, self.pattern.columns
        down, across = self.margin * rows, self.margin * columns
        grid = np.full((height * rows + 2 * down, width * columns + 2 * across), -1, np.int32)
        grid[self.y0 : self.y0 + self.face_ids.shape[0], self.x0 : self.x0 + self.face_ids.shape[1]] = self.face_ids
        return grid[down : down + height * rows, across : across + width * columns]

    def points(self, rows: NDArray[np.integer], columns: NDArray[np.integer]) -> Array:
        """Pixel coordinates (N, 2) of the samples at ``rows`` (N,) and ``columns`` (N,) of the window."""
        pattern, rows = self.pattern, rows + self.y0
        x = (columns + self.x0 + pattern.shifts[rows % pattern.rows]) / pattern.columns - self.margin
        return np.stack([x, (rows + 0.5) / pattern.rows - self.margin], 1)


def rasterize(
    positions: NDArray[np.floating],
    triangles: NDArray[np.int32],
    camera: Camera,
    samples: int = 1,
    margin: int = 0,
    near: float = NEAR_M,
    *,
    pattern: Pattern | None = None,
) -> Raster:
    """Find the nearest face behind every subsample. Both sides of a face are seen, as in Cycles.

    Args:
        positions: (V, 3) vertices in the camera's world, metres. Faces of NaN or infinite vertices are left out, with
            a warning that counts the vertices.
        triangles: (F, 3) vertex indices. Faces without area draw nothing.
        camera: OpenCV pinhole.
        samples: a pixel has ``samples`` x ``samples`` subsamples, placed by :func:`pattern.pattern`.
        margin: pixels around the image to rasterize as well (the pixel filter reaches beyond its edge).
        near: faces nearer than this, metres along z, are cut off.
        pattern: where the subsamples lie, in place of ``samples``.

    Raises:
        RaucaError: samples outside 1 to 16, an image of more than 16384 pixels along a side, margin included, or
            triangles of vertices that do not exist.
    """
    pattern = pattern or pattern_of(samples)
    width, height = camera.width + 2 * margin, camera.height + 2 * margin
    if max(width, height) > MAX_SIDE:
        raise RaucaError(f"camera: {width}x{height} pixels are too many to rasterize; choose at most {MAX_SIDE} a side")
    positions, triangles = np.ascontiguousarray(positions), np.ascontiguousarray(triangles, np.int32)
    if triangles.size and triangles.view(np.uint32).max() >= len(positions):  # numba would read beyond, or before
        raise RaucaError(f"mesh: triangles name vertices outside 0 to {len(positions) - 1}; repair the mesh")
    screen = Screen.of(camera, pattern, margin, near)
    face_ids, window, broken = draw(positions, triangles, screen)
    if broken:
        warnings.warn(
            f"mesh: {broken} vertices are NaN, infinite or beyond {LIMIT:.0e} m; their faces are left out", stacklevel=2
        )
    x0, y0 = window[0] - screen.limits[0], window[1] - screen.limits[1]
    return Raster(face_ids, x0, y0, pattern, margin, positions, triangles, screen.matrix)


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
    return rasterize(flat, np.arange(len(flat), dtype=np.int32).reshape(-1, 3), camera, samples)


@njit(cache=True, nogil=True)
def _invert_seen(
    face_ids: NDArray[np.int32],
    positions: NDArray[np.floating],
    triangles: NDArray[np.int32],
    matrix: Array,
    planes: Array,
) -> None:
    """Invert the homogeneous corners (as rows) of every face in ``face_ids``."""
    done, corners = np.zeros(planes.shape[0], np.bool_), np.empty((3, 3))
    for row in range(face_ids.shape[0]):
        for column in range(face_ids.shape[1]):
            face = face_ids[row, column]
            if face < 0 or done[face]:
                continue
            done[face] = True
            for n in range(3):
                for m in range(3):
                    corners[n, m] = matrix[m, 3]
                    for d in range(3):
                        corners[n, m] += matrix[m, d] * np.float64(positions[triangles[face, n], d])
            _invert(corners, planes[face])


@njit(cache=True, nogil=True, error_model="numpy")
def _invert(corners: Array, inverse: Array) -> None:
    for n in range(3):
        a, b = corners[(n + 1) % 3], corners[(n + 2) % 3]
        inverse[0, n] = a[1] * b[2] - a[2] * b[1]
        inverse[1, n] = a[2] * b[0] - a[0] * b[2]
        inverse[2, n] = a[0] * b[1] - a[1] * b[0]
    determinant = corners[0, 0] * inverse[0, 0] + corners[0, 1] * inverse[1, 0] + corners[0, 2] * inverse[2, 0]
    if abs(determinant) > TINY:
        inverse /= determinant
    else:
        inverse[:] = 0.0  # a face seen edge-on, that rounding shows for a sample or two
