"""The facet texture tensor T_fc [nf, ts, ts, ts, 3] of Neural Renderer, as sparse operators.

Every face owns ts^3 cells, addressed by its barycentrics times ts - 1. The paper fills them from the UV map in two ways
(its Algorithms 1 and 2), and Neural Renderer then reads pixels from the cells. All three steps are linear and depend on
geometry only, so each is an operator here; the published code works them out at every step.

DAS and FCA optimize the cells themselves, without a UV map in between. To deploy such a texture it is baked: every
texel of the atlas reads the cells of the face under it.

Cell (m, x, y, z) is row ``((m * ts + x) * ts + y) * ts + z``. Texel (row, column) of the map is column
``row * size + column``. Map coordinates follow this project, not the published code: u * size - 0.5, row 0 at the top,
clamped to the map. Faces that are mirrored in the atlas are used like any other; the published code skips them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..contract import Camera, RaucaError, Vehicle
from .lookup import Fragments
from .mipmap import Pyramid
from .onto_atlas import read_on_atlas
from .raster.pattern import pattern
from .raster.rasterize import Raster, rasterize_atlas
from .sparse import SparseOperator, from_triplets
from .surface import Array, Surface, find_surface, mask_at
from .taps import Taps, filter_view

Float = type[np.floating]

TEXTURE_SIZE = 6  # ts of T_fc in DAS, FCA and the paper's published code
CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])


def check_texture_size(faces: int, ts: int) -> None:
    """Raise `RaucaError` unless ``ts`` >= 2 and the cells of ``faces`` can be counted in 31 bits."""
    if ts < 2 or faces * ts**3 >= 2**31:
        raise RaucaError(
            f"texture size: {ts} does not do for {faces} faces; choose 2 or more, and fewer than 2^31 cells"
        )


def cell_points(ts: int) -> Array:
    """Barycentrics (ts^3, 3) that the cells of a face stand for: (x, y, z) / (ts - 1), normalized where not all zero.

    Cells on one ray from the origin stand for the same point: at ts = 6 there are 216 cells and far fewer points.
    """
    cells = np.stack(np.meshgrid(*[np.arange(ts)] * 3, indexing="ij"), -1).reshape(-1, 3) / (ts - 1)
    total = cells.sum(1, keepdims=True)
    return np.where(total > 0, cells / np.maximum(total, 1e-300), cells)


def tensor_traversal(uvs: NDArray[np.floating], size: int, ts: int, dtype: Float = np.float32) -> SparseOperator:
    """Algorithm 1: every cell is one bilinear sample of the map.

    A cell's place on the map is Neural Renderer's: its normalized barycentrics (`cell_points`) times the three UVs.
    Cell (0, 0, 0), whose barycentrics are all zero, falls on u = v = 0 as it does there.

    The printed weight, ``|p_i[0] - a| * |p_i[1] - b|``, would give the *nearest* neighbor the least; the text says
    "interpolating", so we read ``(1 - |p_i[0] - a|) * (1 - |p_i[1] - b|)``.

    Args:
        uvs: (nf, 3, 2) per corner, u right, v up.
        size: side of the map, texels.
        ts: texture size.

    Returns:
        Operator from size^2 texels to nf * ts^3 cells; every row sums to 1.
    """
    check_texture_size(len(uvs), ts)
    uv = np.einsum("ck,nkd->ncd", cell_points(ts), uvs.astype(np.float64)).reshape(-1, 2)
    point = np.clip(np.stack([uv[:, 0], 1 - uv[:, 1]], 1) * size - 0.5, 0.0, size - 1.0)
    low = point.astype(np.int64)
    fraction, weights, columns = point - low, np.empty((len(uv), 4)), np.empty((len(uv), 4), np.int64)
    for k, (right, down) in enumerate(((0, 0), (1, 0), (0, 1), (1, 1))):
        column, row = np.minimum(low + np.array([right, down]), size - 1).T
        columns[:, k] = row * size + column
        weights[:, k] = np.abs(1 - right - fraction[:, 0]) * np.abs(1 - down - fraction[:, 1])
    rows = np.repeat(np.arange(len(uv)), 4)
    return from_triplets(rows, columns.ravel(), weights.ravel(), (len(uv), size**2), dtype)


def uv_traversal(
    uvs: NDArray[np.floating],
    size: int,
    ts: int,
    dtype: Float = np.float32,
    faces: NDArray[np.integer] | None = None,
) -> SparseOperator:
    """Algorithm 2: every texel is shared out among the eight cells around it, and each cell takes its weighted mean.

    A texel belongs to the face of the atlas under its center, the lowest where charts overlap. Cells that no texel
    reaches stay black: their rows are empty. Faces smaller than a texel's spacing may have nothing but such cells.

    As in `tensor_traversal` the printed weight ``prod |p_i - a|`` is read as ``prod (1 - |p_i - a|)``.

    Args:
        faces: (n,) keep the cells of these faces only, in this order; texels still belong to whichever face owns them.

    Returns:
        Operator from size^2 texels to n * ts^3 cells; every row sums to 1 or is empty.
    """
    check_texture_size(len(uvs), ts)
    faces = np.arange(len(uvs)) if faces is None else faces
    rank = np.full(len(uvs), -1, np.int64)
    rank[faces] = np.arange(len(faces))
    texel, owner, barycentrics = texel_owners(uvs, size, rank >= 0)
    cells, weights = _around(barycentrics, ts)
    rows = (rank[owner][:, None] * ts**3 + cells).ravel()
    total = np.bincount(rows, weights.ravel(), len(faces) * ts**3)
    share = np.divide(weights.ravel(), total[rows], out=np.zeros(rows.shape), where=total[rows] > 0)
    return from_triplets(rows, np.repeat(texel, 8), share, (len(faces) * ts**3, size**2), dtype)


def texel_owners(
    uvs: NDArray[np.floating], size: int, wanted: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int32], Array]:
    """Texels (N,) whose centers lie on a wanted face: flat places on the map, faces and barycentrics (N, 3)."""
    raster = rasterize_atlas(uvs, size)
    surface = find_surface(raster, wanted)
    rows, columns = np.nonzero(surface.index >= 0)
    return (rows + raster.y0) * size + columns + raster.x0, surface.faces, surface.barycentrics


def facet_fragments(vehicle: Vehicle, surface: Surface, ts: int, rank: NDArray[np.int64]) -> Fragments:
    """How Neural Renderer reads a pixel: trilinear among the eight cells around barycentrics * (ts - 1). K = 8.

    Cells that are black for want of a texel are read all the same.

    Args:
        rank: (F,) place of each face among those whose cells are numbered; the fragments' "texels" are those cells.
    """
    number = int(rank.max(initial=0)) + 1
    check_texture_size(number, ts)
    cells, weights = _around(surface.barycentrics, ts)
    cells += rank[surface.faces][:, None] * ts**3
    paint = mask_at(vehicle.paint_mask, np.clip(surface.interpolate(vehicle.uvs), 0.0, 1.0))
    return Fragments(surface.index, cells.astype(np.int32), weights.astype(np.float32), paint, number * ts**3)


def onto_pyramid(operator: SparseOperator, pyramid: Pyramid) -> SparseOperator:
    """The same operator on the pyramid's list of texels instead of the whole map.

    Taps on texels that are not paintable are dropped and the row normalized again, so gutters never darken a cell.
    The published code reads whatever the gutters hold: this favors its samplers.
    """
    places = pyramid.slots[0].ravel()[operator.columns]
    rows = np.repeat(np.arange(operator.shape[0]), np.diff(operator.indptr))
    weights = np.where(places >= 0, operator.weights, 0).astype(np.float64)
    total = np.bincount(rows, weights, operator.shape[0])
    weights = np.divide(weights, total[rows], out=np.zeros(rows.shape), where=total[rows] > 0)
    shape = (operator.shape[0], pyramid.count)
    return from_triplets(rows, np.maximum(places, 0), weights, shape, operator.weights.dtype.type)


def _around(barycentrics: Array, ts: int) -> tuple[NDArray[np.int64], Array]:
    """The eight cells (N, 8) within a face around each point, and their trilinear weights (N, 8)."""
    point = barycentrics * (ts - 1)
    low = np.minimum(point.astype(np.int64), ts - 2)
    cells = (low[:, None, :] + CORNERS) @ np.array([ts * ts, ts, 1])
    fraction = (point - low)[:, None, :]
    return cells, np.where(CORNERS, fraction, 1 - fraction).prod(2)


def cells_pyramid(vehicle: Vehicle, texture_size: int = TEXTURE_SIZE) -> Pyramid:
    """The cells of the paint faces as a list without coarser levels; cell c of paint face m is m * ts^3 + c.

    Raises:
        RaucaError: a texture size below 2, or so large that the cells cannot be counted.
    """
    faces = int(vehicle.paint_faces().sum())
    check_texture_size(faces, texture_size)
    count = faces * texture_size**3
    side = math.isqrt(count) | 1  # odd: nothing to halve
    side += 2 * (side**2 < count)
    return Pyramid((np.arange(side**2) < count).astype(np.float32).reshape(side, side))


@dataclass(frozen=True)
class FacetSettings:
    """Taps on the cells; samples and filter as in `build_taps`. The defaults are Neural Renderer's: 2 x 2, averaged."""

    samples: int = 2
    filter: str = "box"
    texture_size: int = TEXTURE_SIZE

    def pyramid(self, vehicle: Vehicle) -> Pyramid:
        return cells_pyramid(vehicle, self.texture_size)

    def build(self, vehicle: Vehicle, camera_in_vehicle: Camera, pyramid: Pyramid) -> Taps:
        """The taps of one view from the cells of :func:`cells_pyramid`.

        Raises:
            RaucaError: unknown filter, too many samples.
        """

        def look(raster: Raster) -> Fragments:
            surface = find_surface(raster, vehicle.paint_faces())
            return facet_fragments(vehicle, surface, self.texture_size, _ranks(vehicle))

        return filter_view(vehicle, camera_in_vehicle, pyramid, look, pattern(self.samples), self.filter)


def bake_facets(vehicle: Vehicle, atlas: Pyramid, cells: Pyramid, texture_size: int = TEXTURE_SIZE) -> SparseOperator:
    """From the cells to the paintable texels of the UV atlas: the facet texture as a UV map.

    What is lost: a texel on the seam of two faces is the mean of both; views then filter texels, not cells.

    Raises:
        RaucaError: an atlas of another vehicle.
    """
    ranks = _ranks(vehicle)

    def look(surface: Surface) -> tuple[NDArray[np.int32], Array]:
        found = facet_fragments(vehicle, surface, texture_size, ranks)
        return found.texels, found.weights.astype(np.float64)

    return read_on_atlas(vehicle, atlas, cells, look)


def cell_positions(vehicle: Vehicle, texture_size: int = TEXTURE_SIZE) -> NDArray[np.float32]:
    """Where on the body each cell lies, metres: (paint faces * ts^3, 3), in the vehicle's frame.

    The cell (0, 0, 0), which stands for no point, is put at the face's center.
    """
    points = cell_points(texture_size)
    points[points.sum(1) == 0] = 1 / 3
    corners = vehicle.positions[vehicle.triangles[vehicle.paint_faces()]]
    return np.einsum("ck,fkd->fcd", points.astype(np.float32), corners).reshape(-1, 3)


def _ranks(vehicle: Vehicle) -> NDArray[np.int64]:
    """(F,) place of each face among the paint faces."""
    return np.asarray(np.cumsum(vehicle.paint_faces()) - 1, np.int64)
