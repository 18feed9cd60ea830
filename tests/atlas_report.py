"""How good a UV atlas is, in figures: what tests of unwrapping hold it to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from rauca_core.contract import Vehicle
from rauca_core.geometry.atlas import chart_of_faces, covered, density_spread, signed_uv_area
from rauca_core.geometry.mesh import face_normals

PADDING_SEARCH = 16  # texels; a wider gap is reported as this


@dataclass(frozen=True)
class AtlasReport:
    """Figures of the paint's UV atlas, at the size of the paint mask.

    Attributes:
        charts: connected pieces of the atlas.
        overlap: texels whose center lies inside more than one face, as a fraction of those inside any.
        worst_spread: the largest, of any chart, area-weighted coefficient of variation of its faces' texel density
            ``sqrt(uv area / surface area)``; 0 keeps every distance ratio of areas exactly.
        density_of_charts: coefficient of variation of the charts' mean densities, weighted by area.
        padding_texels: least number of untouched texels between two charts, up to ``PADDING_SEARCH``.
        border_texels: least number of untouched texels between a chart and the border of the atlas.
        utilisation: fraction of the atlas's texels whose center lies inside a face.
        out_of_range: corners outside [0, 1].
        degenerate: faces of no UV area, or mirrored against the majority of their chart.
    """

    charts: int
    overlap: float
    worst_spread: float
    density_of_charts: float
    padding_texels: int
    border_texels: int
    utilisation: float
    out_of_range: int
    degenerate: int


def atlas_report(vehicle: Vehicle) -> AtlasReport:
    """Measure the UV atlas of a vehicle's paint faces at the paint mask's size."""
    paint = vehicle.paint_faces()
    uvs = vehicle.uvs[paint].astype(np.float64)
    faces, size = vehicle.triangles[paint], len(vehicle.paint_mask)
    chart = chart_of_faces(faces, vehicle.uvs[paint])
    charts = int(chart.max(initial=-1)) + 1
    _, area = face_normals(vehicle.positions, faces)
    uv_area = signed_uv_area(uvs)
    density = np.sqrt(np.abs(uv_area) / np.maximum(area, 1e-30))
    weight = np.bincount(chart, area, charts)
    mean = np.bincount(chart, area * density, charts) / weight
    spread = density_spread(uvs, vehicle.positions, faces, chart)
    overall = np.average(mean, weights=weight)
    majority = np.sign(np.bincount(chart, uv_area, charts))
    texels, _ = covered(uvs, size, conservative=False)
    unique = len(np.unique(texels))
    padding, border = _clearances(uvs, chart, size)
    return AtlasReport(
        charts=charts,
        overlap=(np.bincount(texels, minlength=1) > 1).sum() / max(unique, 1),
        worst_spread=float(np.round(spread, 5).max(initial=0.0)),
        density_of_charts=float(np.sqrt(np.average((mean - overall) ** 2, weights=weight)) / overall),
        padding_texels=padding,
        border_texels=border,
        utilisation=unique / size**2,
        out_of_range=int(((uvs < 0) | (uvs > 1)).any(axis=2).sum()),
        degenerate=int((uv_area * majority[chart] <= 0).sum()),
    )


def _clearances(uvs: NDArray[np.float64], chart: NDArray[np.int64], size: int) -> tuple[int, int]:
    """Least number of texels untouched by any face between two charts, and between a chart and the border."""
    texels, faces = covered(uvs, size, conservative=True)
    owner = np.full((size, size), -1, np.int64)
    owner.ravel()[texels] = chart[faces]
    if (owner.ravel()[texels] != chart[faces]).any():
        padding = 0
    else:
        padding = next((d - 1 for d in range(1, PADDING_SEARCH + 1) if _touch(owner, d)), PADDING_SEARCH)
    rows, columns = np.nonzero(owner >= 0)
    edges = [rows.min(), columns.min(), size - 1 - rows.max(), size - 1 - columns.max()] if len(rows) else [size]
    return padding, int(min(edges))


def _touch(owner: NDArray[np.int64], distance: int) -> bool:
    """True when texels of two charts lie ``distance`` apart or less (the larger of rows and columns)."""
    window = 2 * distance + 1
    highest = maximum_filter(owner, window, mode="nearest")
    lowest = minimum_filter(np.where(owner < 0, owner.max(), owner), window, mode="nearest")
    return bool(((owner >= 0) & ((highest != owner) | (lowest != owner))).any())
