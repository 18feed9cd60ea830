"""Merging fragments into pixels: numba kernels that build the rows of a view's taps."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def merge_pixels(
    index: Any, texels: Any, weights: Any, paint: Any, place: Any, table: Any, reach: int, count: int
) -> Any:
    """Filter fragments into pixels, merging taps on the same texel.

    Args:
        index: (h, w) fragment of each sample in the window, or -1.
        texels, weights, paint: of the fragments, see `fragments.Fragments`.
        place: x0, y0, columns, rows, margin, width, height of the raster, a pixel's pattern and the image.
        table: ((2 * reach + 1) * rows, (2 * reach + 1) * columns) weights of the pixel filter.
        reach: pixels that the filter reaches beyond its own.
        count: texels in the pyramid.

    Returns:
        pixels (R,) int32 ``row * width + column`` with any paint; alpha (R,) float32; indptr (R + 1,); columns (N,)
        int32; values (N,) float64, each row summing to 1.
    """
    x0, y0, across, down, margin, width, height = place
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
    row = end = 0
    for y in range(first[1], last[1]):
        for x in range(first[0], last[0]):
            alpha, begin = 0.0, end
            for j in range(table.shape[0]):
                sy = (y + margin - reach) * down + j - y0
                if sy < 0 or sy >= index.shape[0]:
                    continue
                for i in range(table.shape[1]):
                    sx = (x + margin - reach) * across + i - x0
                    if sx < 0 or sx >= index.shape[1]:
                        continue
                    n = index[sy, sx]
                    share = table[j, i] * paint[n] if n >= 0 else 0.0
                    if share <= 0.0:
                        continue
                    alpha += share
                    if end + weights.shape[1] > columns.shape[0]:
                        columns, values = _grown(columns), _grown(values)
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
            if alpha < 1e-7:
                for k in range(begin, end):
                    owner[columns[k]] = -1
                end = begin
                continue
            values[begin:end] /= alpha
            pixels[row], alphas[row] = y * width + x, min(alpha, 1.0)
            row += 1
            indptr[row] = end
    return pixels[:row].copy(), alphas[:row].copy(), indptr[: row + 1].copy(), columns[:end], values[:end]


@njit(cache=True, nogil=True)
def fill_fringe(rows: Any, shape: Any, threshold: float, count: int) -> Any:
    """Give pixels of little or no coverage the texture of their painted neighbours.

    A pixel of alpha below ``threshold`` within two pixels of a painted one reads the mean of the rows in its 5x5
    neighbourhood, weighted by ``alpha / (1 + distance^2)``. Other rows are copied. ``rows`` is what
    :func:`merge_pixels` returns, and so is the result; alpha is 0 on pixels that had none.
    """
    pixels, alphas, indptr, columns, values = rows
    width, height = shape
    row_of = np.full(width * height, -1, np.int32)
    wanted = np.zeros(width * height, np.bool_)
    for r in range(pixels.shape[0]):
        row_of[pixels[r]] = r
        if alphas[r] >= threshold:
            y, x = pixels[r] // width, pixels[r] % width
            for ny in range(max(0, y - 2), min(height, y + 3)):
                wanted[ny * width + max(0, x - 2) : ny * width + min(width, x + 3)] = True
        wanted[pixels[r]] = True
    new_pixels = np.flatnonzero(wanted).astype(np.int32)
    new_alphas, new_indptr = np.zeros(new_pixels.shape[0], np.float32), np.zeros(new_pixels.shape[0] + 1, np.int64)
    new_columns, new_values = np.empty(columns.shape[0] + 4096, np.int32), np.empty(columns.shape[0] + 4096, np.float64)
    owner, slot = np.full(count, -1, np.int32), np.zeros(count, np.int64)
    end = 0
    for n in range(new_pixels.shape[0]):
        begin, own, total = end, row_of[new_pixels[n]], 0.0
        y, x = new_pixels[n] // width, new_pixels[n] % width
        new_alphas[n] = alphas[own] if own >= 0 else 0.0
        span = 0 if new_alphas[n] >= threshold else 2
        for ny in range(max(0, y - span), min(height, y + span + 1)):
            for nx in range(max(0, x - span), min(width, x + span + 1)):
                r = row_of[ny * width + nx]
                if r < 0:
                    continue
                share = alphas[r] / (1.0 + (ny - y) ** 2 + (nx - x) ** 2)
                total += share
                while end + indptr[r + 1] - indptr[r] > new_columns.shape[0]:
                    new_columns, new_values = _grown(new_columns), _grown(new_values)
                for k in range(indptr[r], indptr[r + 1]):
                    texel = columns[k]
                    if owner[texel] != n:
                        owner[texel], slot[texel] = n, end
                        new_columns[end], new_values[end] = texel, 0.0
                        end += 1
                    new_values[slot[texel]] += share * values[k]
        new_values[begin:end] /= total
        new_indptr[n + 1] = end
    return new_pixels, new_alphas, new_indptr, new_columns[:end].copy(), new_values[:end].copy()


@njit(cache=True, nogil=True)
def _grown(array: Any) -> Any:
    larger = np.empty(array.shape[0] * 2, array.dtype)
    larger[: array.shape[0]] = array
    return larger
