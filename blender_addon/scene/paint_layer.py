"""Unwrapping the paint of objects in the open scene into a UV layer of its own, and checking what is there."""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import contract, geometry
from .mesh_edits import require_own_faces, write_layer
from .uvs import uv_faults
from .vehicle_arrays import Piece
from .vehicle_reading import Reading


def to_unwrap(reading: Reading) -> contract.Vehicle:
    """The vehicle of the objects that were read, without UVs on its paint; raises as :func:`require_own_faces`."""
    require_own_faces(reading.soup.painted(reading.paint))
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
    pieces = reading.soup.painted(reading.paint)
    require_own_faces(pieces)
    same = np.array_equal(fresh.positions, reading.soup.positions.astype(np.float32))
    if not (same and np.array_equal(fresh.triangles, reading.soup.triangles)):
        raise contract.RaucaError(f"{reading.request.where}: changed while it was unwrapped; unwrap it again")
    if not np.array_equal(fresh.paint_faces(), reading.paint):
        raise contract.RaucaError(f"{reading.request.where}: its paint changed while it was unwrapped; unwrap it again")
    fresh = _untorn(fresh, pieces)
    for piece in pieces:
        write_layer(piece, reading.paint[piece.span], fresh.uvs[piece.span])
    charts = geometry.chart_of_faces(fresh.triangles[reading.paint], fresh.uvs[reading.paint])
    return int(charts.max()) + 1


def check_paint(reading: Reading) -> dict[str, NDArray[np.bool_]]:
    """Judge the UVs of the paint, see :func:`uv_faults`."""
    _, area = geometry.face_normals(reading.soup.positions, reading.soup.triangles[reading.paint])
    return uv_faults(reading.soup.uvs[reading.paint], area)


def polygons_of(reading: Reading, faults: NDArray[np.bool_]) -> dict[bpy.types.Object, NDArray[np.bool_]]:
    """The faulty polygons (polygons,) of each object that has any, from faulty paint triangles (F_paint,).

    Raises as :func:`require_own_faces`.
    """
    faulty = np.zeros(len(reading.paint), np.bool_)
    faulty[reading.paint] = faults
    pieces = reading.soup.painted(faulty)
    require_own_faces(pieces)
    wanted = {piece.owner: np.zeros(len(piece.owner.data.polygons), np.bool_) for piece in pieces}
    for piece in pieces:
        wanted[piece.owner][piece.polygon[faulty[piece.span]]] = True
    return wanted


def _untorn(vehicle: contract.Vehicle, pieces: list[Piece]) -> contract.Vehicle:
    """The vehicle with polygons whose triangles disagree about a shared corner's UV laid flat, beside the atlas."""
    paint, first = vehicle.paint_faces(), 0
    polygon, loops = np.full(len(paint), -1), np.full((len(paint), 3), -1)  # counted over all pieces
    for piece in pieces:
        polygon[piece.span], loops[piece.span] = piece.polygon + first, piece.loops + first
        first += len(piece.owner.data.loops)
    polygon, loops, flat = polygon[paint], loops[paint], vehicle.uvs[paint]
    last = np.zeros((first, 2), np.float32)
    last[loops.ravel()] = flat.reshape(-1, 2)
    torn = np.isin(polygon, polygon[(last[loops] != flat).any(axis=(1, 2))])
    if not torn.any():
        return vehicle
    corners = vehicle.positions[vehicle.triangles[paint][torn]].astype(np.float64)
    mended = flat.astype(np.float64)
    mended[torn] = _laid_flat(corners, np.unique(polygon[torn], return_inverse=True)[1], float(mended.max()))
    return geometry.repack(vehicle, mended)


def _laid_flat(corners: NDArray[np.float64], number: NDArray[np.intp], right_of: float) -> NDArray[np.float64]:
    """Places (F, 3, 2) in a grid for triangles (F, 3, 3) of polygons ``number`` (F,), each in its polygon's plane."""
    count = int(number.max()) + 1
    normal = np.zeros((count, 3))
    np.add.at(normal, number, np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    aside = np.eye(3)[np.argmin(np.abs(normal), axis=1)]  # the axis least along the normal
    right = np.cross(aside, normal)
    right /= np.maximum(np.linalg.norm(right, axis=1, keepdims=True), 1e-30)
    axes = np.stack([right, np.cross(normal, right)], axis=1)
    laid = np.einsum("fcx,fax->fca", corners, axes[number])
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, number, laid.min(axis=1))
    np.maximum.at(high, number, laid.max(axis=1))
    side = int(np.ceil(np.sqrt(count)))
    step = (high - low).max() * 1.5
    grid = np.stack([np.arange(count) % side, np.arange(count) // side], axis=1) * step
    return laid - low[number][:, None] + grid[number][:, None] + [right_of + step, 0.0]
