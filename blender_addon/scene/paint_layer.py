"""Unwrapping the paint of objects in the open scene into a UV layer of its own, and checking what is there."""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import contract, geometry
from .mesh_edits import require_own_faces, write_layer
from .uvs import UvFaults, uv_faults
from .vehicle_arrays import Piece
from .vehicle_reading import Reading


def to_unwrap(reading: Reading) -> contract.Vehicle:
    """The vehicle of the objects that were read, without UVs on its paint; raises as :func:`require_own_faces`."""
    require_own_faces(piece for piece, _ in reading.soup.painted(reading.paint))
    return reading.with_uvs(np.zeros((int(reading.paint.sum()), 3, 2), np.float32), keep_textures=False)


def write_unwrapped(reading: Reading, fresh: contract.Vehicle) -> int:
    """Write the atlas of ``fresh``, the unwrapped :func:`to_unwrap`, into a UV layer of the objects that were read.

    The other layers stay. A polygon is never torn: where the atlas cuts one along its diagonal, it becomes a chart of
    its own.

    Returns:
        The number of charts.

    Raises:
        RaucaError: the objects are not those that were unwrapped, or cannot be written to; nothing was changed.
    """
    spans = reading.soup.painted(reading.paint)
    require_own_faces(piece for piece, _ in spans)
    same = np.array_equal(fresh.positions, reading.soup.positions.astype(np.float32))
    if not (same and np.array_equal(fresh.triangles, reading.soup.triangles)):
        raise contract.RaucaError(f"{reading.request.where}: changed while it was unwrapped; unwrap it again")
    if not np.array_equal(fresh.paint_faces(), reading.paint):
        raise contract.RaucaError(f"{reading.request.where}: its paint changed while it was unwrapped; unwrap it again")
    torn = _torn(fresh.uvs, reading, spans)
    if torn.any():
        flat = fresh.uvs[reading.paint].astype(np.float64)
        fresh = geometry.repack(fresh, _mended(flat, fresh, reading, spans, torn))
    for piece, span in spans:
        write_layer(piece, reading.paint[span], fresh.uvs[span])
    charts = geometry.chart_of_faces(fresh.triangles[reading.paint], fresh.uvs[reading.paint])
    return int(charts.max()) + 1


def check_paint(reading: Reading) -> UvFaults:
    """Judge the UVs of the paint, (F_paint,) each."""
    _, area = geometry.face_normals(reading.soup.positions, reading.soup.triangles[reading.paint])
    return uv_faults(reading.soup.uvs[reading.paint], area)


def polygons_of(reading: Reading, faults: NDArray[np.bool_]) -> dict[bpy.types.Object, NDArray[np.bool_]]:
    """The faulty polygons (polygons,) of each object that has any, from faulty paint triangles (F_paint,).

    Raises as :func:`require_own_faces`.
    """
    faulty = np.zeros(len(reading.paint), np.bool_)
    faulty[reading.paint] = faults
    spans = [(piece, span) for piece, span in reading.soup.painted(reading.paint) if faulty[span].any()]
    require_own_faces(piece for piece, _ in spans)
    wanted = {}
    for piece, span in spans:
        polygons = np.zeros(len(piece.owner.data.polygons), np.bool_)
        polygons[piece.polygon[faulty[span]]] = True
        wanted[piece.owner] = polygons
    return wanted


def _polygon_ids(reading: Reading, spans: list[tuple[Piece, slice]]) -> NDArray[np.int64]:
    """(F_paint,) number of each paint triangle's polygon, counted over all pieces."""
    ids = np.full(len(reading.paint), -1, np.int64)
    first = 0
    for piece, span in spans:
        ids[span] = piece.polygon + first
        first += int(piece.polygon.max()) + 1
    return ids[reading.paint]


def _torn(uvs: NDArray[np.float32], reading: Reading, spans: list[tuple[Piece, slice]]) -> NDArray[np.bool_]:
    """(F_paint,) True on triangles of a polygon whose triangles disagree about the UV of a shared corner."""
    torn = np.zeros(len(reading.paint), np.bool_)
    for piece, span in spans:
        painted = reading.paint[span]
        loops, values = piece.loops[painted].ravel(), uvs[span][painted].reshape(-1, 2)
        last = np.zeros((int(piece.loops.max()) + 1, 2), np.float32)
        last[loops] = values
        apart = (last[loops] != values).any(axis=1).reshape(-1, 3).any(axis=1)
        polygons = np.zeros(int(piece.polygon.max()) + 1, np.bool_)
        polygons[piece.polygon[painted][apart]] = True
        torn[span] = painted & polygons[piece.polygon]
    return torn[reading.paint]


def _mended(
    flat: NDArray[np.float64],
    vehicle: contract.Vehicle,
    reading: Reading,
    spans: list[tuple[Piece, slice]],
    torn: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """``flat`` (F_paint, 3, 2) with each torn polygon laid flat beside the atlas, in its own plane."""
    polygon, number = np.unique(_polygon_ids(reading, spans)[torn], return_inverse=True)
    corners = vehicle.positions[vehicle.triangles[reading.paint][torn]].astype(np.float64)
    normal = np.zeros((len(polygon), 3))
    np.add.at(normal, number, np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    aside = np.eye(3)[np.argmin(np.abs(normal), axis=1)]  # the axis least along the normal
    right = np.cross(aside, normal)
    right /= np.maximum(np.linalg.norm(right, axis=1, keepdims=True), 1e-30)
    axes = np.stack([right, np.cross(normal, right)], axis=1)
    laid = np.einsum("fcx,fax->fca", corners, axes[number])
    low = np.full((len(polygon), 2), np.inf)
    high = np.full((len(polygon), 2), -np.inf)
    for extreme, ufunc in ((low, np.minimum), (high, np.maximum)):
        for corner in range(3):
            ufunc.at(extreme, number, laid[:, corner])
    side = int(np.ceil(np.sqrt(len(polygon))))
    step = (high - low).max() * 1.5
    grid = np.stack([np.arange(len(polygon)) % side, np.arange(len(polygon)) // side], axis=1) * step
    mended = flat.copy()
    mended[torn] = laid - low[number][:, None] + grid[number][:, None] + [flat.max() + step, 0.0]
    return mended
