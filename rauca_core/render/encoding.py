"""A view's taps in few bytes: what a file of the tap cache holds.

Places are small steps: pixels ascend, the texels of a row ascend, and neighboring rows begin at neighboring texels.
Each step is an unsigned LEB128 number of mostly one or two bytes, decoded faster than an inflater could. Weights and
coverage are 16-bit fractions of 65535; those of a row keep its sum, 65535 where nothing black is read, so a constant
texture keeps its color exactly.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .kernels import njit

UNIT = 65535
_MAX_BYTES = 5  # of one number: all are below 2^33


def to_fractions(values: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Round values in [0, 1] to 65535ths."""
    return np.rint(values * np.float32(UNIT)).astype(np.uint16)


def from_fractions(fractions: NDArray[np.uint16]) -> NDArray[np.float32]:
    """65535ths to float32, from which :func:`to_fractions` returns to the same fractions."""
    return fractions / np.float32(UNIT)


@njit(cache=True, nogil=True)
def quantize_rows(indptr: Any, values: Any) -> Any:
    """Round rows to uint16 that sum to what the row does: rounding errors are carried along the row, none is lost."""
    result = np.empty(values.shape[0], np.uint16)
    for row in range(indptr.shape[0] - 1):
        exact, given = 0.0, 0
        for k in range(indptr[row], indptr[row + 1]):
            exact += values[k] * UNIT
            result[k] = max(int(np.rint(exact)) - given, 0)
            given += result[k]
    return result


def encode(pixels: NDArray[np.int32], indptr: NDArray[np.int64], columns: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Pack the places of a matrix whose pixels and whose columns within a row ascend."""
    stream = np.empty(_MAX_BYTES * (2 * len(pixels) + len(columns)), np.uint8)
    return stream[: _encode(pixels, indptr, columns, stream)].copy()


def decode(
    stream: NDArray[np.uint8], rows: int, taps: int, pixels: int, texels: int
) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.int32]] | None:
    """Unpack what :func:`encode` packed: pixels (rows,), indptr (rows + 1,), columns (taps,).

    None when the stream does not hold exactly that, or points beyond ``pixels`` or ``texels``: kernels read without
    bounds checks.
    """
    found, indptr, columns = np.empty(rows, np.int32), np.zeros(rows + 1, np.int64), np.empty(taps, np.int32)
    return (found, indptr, columns) if _decode(stream, found, indptr, columns, pixels, texels) else None


@njit(cache=True, nogil=True)
def _encode(pixels: Any, indptr: Any, columns: Any, stream: Any) -> int:
    end, pixel, first = 0, np.int64(-1), np.int64(0)
    for row in range(pixels.shape[0]):
        begin, stop = indptr[row], indptr[row + 1]
        end = _put(stream, end, pixels[row] - pixel - 1)
        end = _put(stream, end, stop - begin)
        pixel = pixels[row]
        for k in range(begin, stop):
            if k == begin:
                step = np.int64(columns[k]) - first
                end = _put(stream, end, 2 * step if step >= 0 else -2 * step - 1)
                first = np.int64(columns[k])
            else:
                end = _put(stream, end, columns[k] - columns[k - 1] - 1)
    return end


@njit(cache=True, nogil=True)
def _decode(stream: Any, pixels: Any, indptr: Any, columns: Any, pixel_limit: int, texel_limit: int) -> bool:
    place, pixel, first, end = 0, np.int64(-1), np.int64(0), np.int64(0)
    for row in range(pixels.shape[0]):
        place, step = _get(stream, place)
        place, count = _get(stream, place)
        pixel += step + 1
        if place < 0 or pixel >= pixel_limit or end + count > columns.shape[0]:
            return False
        pixels[row], texel = pixel, np.int64(0)
        for k in range(count):
            place, step = _get(stream, place)
            if k == 0:
                texel = first + (step // 2 if step % 2 == 0 else -(step + 1) // 2)
                first = texel
            else:
                texel += step + 1
            if place < 0 or texel < 0 or texel >= texel_limit:
                return False
            columns[end] = texel
            end += 1
        indptr[row + 1] = end
    return place == stream.shape[0] and end == columns.shape[0]


@njit(cache=True, nogil=True)
def _put(stream: Any, place: int, number: Any) -> int:
    while number >= 128:
        stream[place] = number % 128 + 128
        number //= 128
        place += 1
    stream[place] = number
    return place + 1


@njit(cache=True, nogil=True)
def _get(stream: Any, place: int) -> Any:
    """The number at ``place`` and the place after it; -1 for a place when the stream ends early or is no number."""
    number, scale = np.int64(0), np.int64(1)
    for _ in range(_MAX_BYTES):
        if place < 0 or place >= stream.shape[0]:
            return np.int64(-1), np.int64(0)
        byte = np.int64(stream[place])
        place += 1
        number += (byte % 128) * scale
        if byte < 128:
            return np.int64(place), number
        scale *= 128
    return np.int64(-1), np.int64(0)
