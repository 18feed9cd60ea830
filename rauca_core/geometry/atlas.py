"""Charts of a UV atlas and how evenly they spend their texels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .mesh import face_normals


def density_spread(
    uvs: NDArray[np.floating],
    positions: NDArray[np.floating],
    triangles: NDArray[np.integer],
    chart: NDArray[np.int64],
) -> NDArray[np.float64]:
    """(charts,) spread of the texel density within each chart.

    The density of a face is ``sqrt(uv area / surface area)``; the spread is the coefficient of variation (standard
    deviation over mean) over a chart's faces, each weighted by its surface area. Faces without area do not count.
    """
    _, area = face_normals(np.asarray(positions, np.float64), triangles)
    density = np.sqrt(np.abs(signed_uv_area(uvs)) / np.maximum(area, 1e-30))
    weight = np.maximum(np.bincount(chart, area), 1e-30)
    mean = np.maximum(np.bincount(chart, area * density) / weight, 1e-30)
    return np.sqrt(np.bincount(chart, area * (density - mean[chart]) ** 2) / weight) / mean


def signed_uv_area(uvs: NDArray[np.floating]) -> NDArray[np.float64]:
    """(F,) area of UV triangles (F, 3, 2), negative where mirrored."""
    one, two = (uvs[:, 1:] - uvs[:, :1]).astype(np.float64).transpose(1, 0, 2)
    return (one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]) / 2


def chart_of_faces(triangles: NDArray[np.integer], uvs: NDArray[np.float32]) -> NDArray[np.int64]:
    """(F,) chart number of each face: faces are joined where they share a vertex with the same UV."""
    keys = np.concatenate([triangles.reshape(-1, 1), np.round(uvs.reshape(-1, 2) * 2**20)], axis=1).astype(np.int64)
    _, corner = np.unique(keys, axis=0, return_inverse=True)
    corner = corner.reshape(-1, 3)
    label = np.arange(corner.max(initial=-1) + 1)
    while True:  # labels sink to the smallest of their chart; pointer jumping keeps the rounds few
        least = label[corner].min(axis=1)
        lowered = label.copy()
        for i in range(3):
            np.minimum.at(lowered, corner[:, i], least)
        lowered = lowered[lowered]
        if (lowered == label).all():
            return np.unique(label[corner[:, 0]], return_inverse=True)[1]
        label = lowered
