"""Merging fragments into pixels: the rows of a view's taps."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..contract import Camera
from ..runtime.kernels import njit
from .lookup import Fragments
from .raster.rasterize import Raster
from .thin import Thinning, thin_row

FAINTEST = 1e-7  # coverage below which a pixel shows no paint


class Rows(NamedTuple):
    """A matrix in compressed rows, one per pixel.

    Attributes:
        pixels: (R,) int32 ``row * width + column``, ascending.
        alpha: (R,) float32 paint coverage in [0, 1].
        indptr: (R + 1,) int64.
        columns: (N,) int32, ascending in each row.
        values: (N,) float64; each row sums to 1.
    """

    pixels: NDArray[np.int32]
    alpha: NDArray[np.float32]
    indptr: NDArray[np.int64]
    columns: NDArray[np.int32]
    values: NDArray[np.float64]


def merge_pixels(
    found: Fragments, raster: Raster, camera: Camera, table: NDArray[np.float64], thinning: Thinning
) -> Rows:
    """Filter the fragments of a view into pixels, one row for each with any paint, and merge taps on the same texel.

    Where a pixel has more samples than textures want, only some rows are read for the taps: see `Pattern.stride`.

    Args:
        found: the fragments of ``raster``.
        raster: with a margin no smaller than the filter's reach.
        camera: whose image it is.
        table: weights of the pixel filter, see `filters.filter_table`.
        thinning: of each row as it is done: whole rows of all pixels at once would take gigabytes.
    """
    pattern = raster.pattern
    place = (raster.x0, raster.y0, pattern.columns, pattern.rows, raster.margin, camera.width, camera.height)
    read = found.index, found.texels, found.weights, found.paint
    return Rows(*_merge(read, place, table, pattern.stride, found.columns, thinning))


@njit(cache=True, nogil=True)
def _merge(found: Any, place: Any, table: Any, stride: int, count: int, thinning: Any) -> Any:
    index = found[0]
    x0, y0, across, down, margin, width, height = place
    reach = (table.shape[0] // down - 1) // 2
    first = max(0, x0 // across - margin - reach), max(0, y0 // down - margin - reach)
    last = (
        min(width, (x0 + index.shape[1]) // across - margin + reach + 1),
        min(height, (y0 + index.shape[0]) // down - margin + reach + 1),
    )
    rows = max(0, last[0] - first[0]) * max(0, last[1] - first[1])
    pixels, alphas = np.empty(rows, np.int32), np.empty(rows, np.float32)
    indptr = np.zeros(rows + 1, np.int64)
    columns, values = np.empty(4096, np.int32), np.empty(4096, np.float64)
    owner, slot = np.full(count, -1, np.int32), np.zeros(count, np.int64)
    one, row, end = np.int64(1), np.int64(0), np.int64(0)  # plain literals would each compile _read_pixel once more
    for y in range(first[1], last[1]):
        for x in range(first[0], last[0]):
            begin, corner = end, ((x + margin - reach) * across - x0, (y + margin - reach) * down - y0)
            sums = _read_pixel(found, corner, table, stride, row, end, columns, values, owner, slot)
            alpha, mass, end, columns, values = sums
            if mass == 0.0 and alpha >= FAINTEST:  # only samples that were left out see the paint
                sums = _read_pixel(found, corner, table, one, row, end, columns, values, owner, slot)
                alpha, mass, end, columns, values = sums
            if alpha < FAINTEST:
                for k in range(begin, end):
                    owner[columns[k]] = -1
                end = begin
                continue
            for k in range(begin, end):
                values[k] /= mass
            alphas[row] = min(alpha, 1.0)
            rounded: Any = np.float64(alphas[row])
            pixels[row] = y * width + x
            columns, values = _with_room(columns, values, 2 * end - begin)
            end = begin + thin_row(columns[begin:], values[begin:], end - begin, rounded, thinning)
            row += 1
            indptr[row] = end
    return pixels[:row].copy(), alphas[:row].copy(), indptr[: row + 1].copy(), columns[:end], values[:end]


@njit(cache=True, nogil=True)
def _read_pixel(
    found: Any,
    corner: Any,
    table: Any,
    stride: Any,
    row: Any,
    end: Any,
    columns: Any,
    values: Any,
    owner: Any,
    slot: Any,
) -> Any:
    """Add up a pixel's samples: its coverage, what of it the taps stand for, and the taps, from place ``end`` on.

    All samples count for the coverage, every ``stride``-th row of them for the taps.
    """
    index, texels, weights, paint = found
    alpha = mass = 0.0
    for j in range(table.shape[0]):
        sy = corner[1] + j
        if sy < 0 or sy >= index.shape[0]:
            continue
        for i in range(table.shape[1]):
            sx = corner[0] + i
            if sx < 0 or sx >= index.shape[1]:
                continue
            n = index[sy, sx]
            share = table[j, i] * paint[n] if n >= 0 else 0.0
            alpha += share
            if share <= 0.0 or j % stride != 0:
                continue
            mass += share
            columns, values = _with_room(columns, values, end + weights.shape[1])
            for k in range(weights.shape[1]):
                value = share * weights[n, k]
                if value <= 0.0:
                    continue
                texel = texels[n, k]
                if owner[texel] != row:
                    owner[texel], slot[texel] = row, end
                    columns[end], values[end] = texel, 0.0
                    end += 1
                values[slot[texel]] += value
    return alpha, mass, end, columns, values


def fill_fringe(rows: Rows, camera: Camera, threshold: float, count: int, thinning: Thinning) -> Rows:
    """Give pixels of little or no coverage the texture of their painted neighbors.

    A pixel of alpha below ``threshold`` within two pixels of a painted one reads the mean of the rows in its 5x5
    neighborhood, weighted by ``alpha / (1 + distance^2)``, thinned. Other rows are copied. Alpha is 0 on pixels that
    had none.
    """
    return Rows(*_fill(tuple(rows), (camera.width, camera.height), threshold, count, thinning))


@njit(cache=True, nogil=True)
def _fill(rows: Any, shape: Any, threshold: float, count: int, thinning: Any) -> Any:
    pixels, alphas, indptr, columns, values = rows
    width, height = shape
    row_of = np.full(width * height, -1, np.int32)
    wanted = np.zeros(width * height, np.bool_)
    for r in range(pixels.shape[0]):
        row_of[pixels[r]] = r
        if alphas[r] >= threshold:
            y, x = pixels[r] // width, pixels[r] % width
            for ny in range(max(0, y - 2), min(height, y + 3)):
                for nx in range(max(0, x - 2), min(width, x + 3)):
                    wanted[ny * width + nx] = True
        wanted[pixels[r]] = True
    new_pixels = np.flatnonzero(wanted).astype(np.int32)
    new_alphas, new_indptr = np.zeros(new_pixels.shape[0], np.float32), np.zeros(new_pixels.shape[0] + 1, np.int64)
    new_columns, new_values = np.empty(columns.shape[0] + 4096, np.int32), np.empty(columns.shape[0] + 4096, np.float64)
    owner, slot = np.full(count, -1, np.int32), np.zeros(count, np.int64)
    end = 0
    for n in range(new_pixels.shape[0]):
        begin, own, total = end, row_of[new_pixels[n]], 0.0
        y, x = new_pixels[n] // width, new_pixels[n] % width
        alpha: Any = np.float64(alphas[own]) if own >= 0 else 0.0
        new_alphas[n] = alpha
        span = 0 if alpha >= threshold else 2
        for ny in range(max(0, y - span), min(height, y + span + 1)):
            for nx in range(max(0, x - span), min(width, x + span + 1)):
                r = row_of[ny * width + nx]
                if r < 0:
                    continue
                share = alphas[r] / (1.0 + (ny - y) ** 2 + (nx - x) ** 2)
                total += share
                new_columns, new_values = _with_room(new_columns, new_values, end + indptr[r + 1] - indptr[r])
                for k in range(indptr[r], indptr[r + 1]):
                    texel = columns[k]
                    if owner[texel] != n:
                        owner[texel], slot[texel] = n, end
                        new_columns[end], new_values[end] = texel, 0.0
                        end += 1
                    new_values[slot[texel]] += share * values[k]
        for k in range(begin, end):
            new_values[k] /= total
        if span > 0:
            new_columns, new_values = _with_room(new_columns, new_values, 2 * end - begin)
            end = begin + thin_row(new_columns[begin:], new_values[begin:], end - begin, alpha, thinning)
        new_indptr[n + 1] = end
    return new_pixels, new_alphas, new_indptr, new_columns[:end].copy(), new_values[:end].copy()


@njit(cache=True, nogil=True)
def _with_room(columns: Any, values: Any, size: int) -> Any:
    """The arrays, moved to larger ones when they hold fewer than ``size`` places."""
    if size <= columns.shape[0]:
        return columns, values
    larger = np.empty(2 * size, columns.dtype), np.empty(2 * size, values.dtype)
    for k in range(columns.shape[0]):
        larger[0][k], larger[1][k] = columns[k], values[k]
    return larger
