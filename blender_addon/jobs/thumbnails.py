"""Small pictures for panels, as arrays: of PNG files that rauca itself writes, and of a curve. No Blender in here."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core import contract, reading

SIDE = 192  # pixels, of a curve, and of a thumbnail at most
HEADER = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4s", 13, b"IHDR")
LARGEST = 64 << 20  # bytes of pixels
STROKE = 1.5  # half the line's width, pixels
COLOR = (0.36, 0.67, 0.95)  # sRGB
GRID = (0.5, 0.5, 0.5, 0.25)
MARGIN = 8  # pixels
MOST_POINTS = SIDE // 4  # the loss of one step jumps with its frames: what counts is how the runs of steps go


def thumbnail(path: Path) -> NDArray[np.uint8] | None:
    """A picture of at most ``SIDE`` pixels a side as (H, W, 3) sRGB bytes, row 0 at the top.

    None when there is no such file, or it is not one that ``contract.files.png_bytes`` wrote: 8 bits, grey or RGB, rows
    unfiltered, all in one chunk.
    """
    try:
        pixels = _pixels(reading.read_limited(path, LARGEST))
    except (contract.RaucaError, ValueError, struct.error, zlib.error):
        return None
    if pixels is None or (factor := -(-max(pixels.shape[:2]) // SIDE)) == 1:
        return pixels
    height, width = (n // factor * factor for n in pixels.shape[:2])
    blocks = pixels[:height, :width].reshape(height // factor, factor, width // factor, factor, 3)
    return np.asarray(blocks.mean((1, 3)) + 0.5, np.uint8)


def _pixels(data: bytes) -> NDArray[np.uint8] | None:
    width, height, depth, kind, *rest, length, chunk = struct.unpack_from(">IIBBBBB4xI4s", data, len(HEADER))
    channels = {0: 1, 2: 3}.get(kind, 0)
    size = height * (width * channels + 1)
    ours = data.startswith(HEADER) and chunk == b"IDAT" and depth == 8 and not any(rest)
    if not ours or not channels or not 0 < size <= LARGEST:
        return None
    # No more than the header promises; ValueError for one that was cut short.
    unpacked = zlib.decompressobj().decompress(data[len(HEADER) + 25 :][:length], size)
    rows = np.frombuffer(unpacked, np.uint8).reshape(height, width * channels + 1)
    if rows[:, 0].any():
        return None
    pixels = rows[:, 1:].reshape(height, width, channels)
    return np.ascontiguousarray(np.broadcast_to(pixels, (height, width, 3)))


def curve(values: Sequence[float]) -> NDArray[np.float32]:
    """Draw ``values`` against their order, from their least to their greatest, as (SIDE, SIDE, 4) sRGB and alpha.

    Colors are premultiplied with alpha, as Blender draws its icons. Row 0 is at the top. Values that are not finite
    are left out; many are drawn by the means of equal runs of them.
    """
    picture = np.zeros((SIDE, SIDE, 4), np.float32)
    inner = SIDE - 2 * MARGIN
    picture[np.linspace(MARGIN, SIDE - 1 - MARGIN, 5).round().astype(int), MARGIN:-MARGIN] = GRID
    points = np.asarray(values, np.float64)
    points = points[np.isfinite(points)]
    if len(points) > MOST_POINTS:
        points = np.array([run.mean() for run in np.array_split(points, MOST_POINTS)])
    if len(points) >= 2:
        low, high = float(points.min()), float(points.max())
        # A flat curve runs through the middle.
        level = (points - low) / (high - low) if high > low else np.full(len(points), 0.5)
        heights = np.interp(np.arange(inner) / (inner - 1), np.linspace(0, 1, len(points)), level)
        _draw(picture[:, MARGIN:-MARGIN], np.asarray(MARGIN + (1 - heights) * (inner - 1), np.float64))
    picture[:, :, :3] *= picture[:, :, 3:]
    return picture


def _draw(picture: NDArray[np.float32], rows: NDArray[np.float64]) -> None:
    """Draw a curve through one row of each column: as thick across as along, however steep; a faint area below it."""
    down = np.arange(len(picture))[:, None]
    picture[(down > rows) & (down < len(picture) - MARGIN)] = (*COLOR, 0.18)
    # In each column it covers what lies between the middles to its neighbors.
    middles = np.concatenate([rows[:1], (rows[1:] + rows[:-1]) / 2, rows[-1:]])
    ends = np.stack([rows, middles[:-1], middles[1:]])
    ends[:, [0, -1]] = rows[[0, -1]]
    beyond = np.maximum(np.maximum(ends.min(axis=0) - down, down - ends.max(axis=0)), 0)
    ink = np.clip(STROKE + 0.5 - beyond, 0, 1)[:, :, None].astype(np.float32)
    picture[:] = picture * (1 - ink) + np.array([*COLOR, 1.0], np.float32) * ink
