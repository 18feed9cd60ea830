"""Small pictures for panels, as arrays: of PNG files that rauca itself writes, and of a curve. No Blender in here."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core import contract, reading

SIDE = 256  # pixels, at most
SIGNATURE = b"\x89PNG\r\n\x1a\n"
LARGEST = 64 << 20  # bytes of pixels


def thumbnail(path: Path) -> NDArray[np.uint8] | None:
    """A picture of at most ``SIDE`` pixels a side as (H, W, 3) sRGB bytes, row 0 at the top.

    None when there is no such file, or it is not one that ``contract.files.png_bytes`` wrote: 8 bits, grey or RGB, rows
    unfiltered.
    """
    try:
        pixels = _pixels(reading.read_limited(path, LARGEST))
    except (contract.RaucaError, ValueError, struct.error, zlib.error):
        return None
    return None if pixels is None else shrink(pixels, SIDE)


def shrink(pixels: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
    """(H, W, 3) bytes made at most ``side`` pixels large by the mean of square blocks."""
    factor = -(-max(pixels.shape[:2]) // side)
    if factor == 1:
        return pixels
    height, width = (n // factor * factor for n in pixels.shape[:2])
    blocks = pixels[:height, :width].reshape(height // factor, factor, width // factor, factor, 3)
    return np.asarray(blocks.mean((1, 3)) + 0.5, np.uint8)


def _pixels(data: bytes) -> NDArray[np.uint8] | None:
    if not data.startswith(SIGNATURE):
        return None
    chunks = _chunks(data)
    width, height, depth, kind, *rest = struct.unpack(">IIBBBBB", chunks[b"IHDR"])
    channels = {0: 1, 2: 3}.get(kind, 0)
    size = height * (width * channels + 1)
    if depth != 8 or not channels or any(rest) or not 0 < size <= LARGEST:
        return None
    unpacked = zlib.decompressobj().decompress(chunks[b"IDAT"], size)  # no more than the header promises
    if len(unpacked) < size:
        return None  # cut short
    rows = np.frombuffer(unpacked, np.uint8).reshape(height, -1)
    if rows[:, 0].any():
        return None
    pixels = rows[:, 1:].reshape(height, width, channels)
    return np.ascontiguousarray(np.broadcast_to(pixels, (height, width, 3)))


def _chunks(data: bytes) -> dict[bytes, bytes]:
    """Chunks by kind; those of one kind are joined."""
    found: dict[bytes, bytes] = {b"IHDR": b"", b"IDAT": b""}
    at = len(SIGNATURE)
    while at + 8 <= len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        found[kind] = found.get(kind, b"") + data[at + 8 : at + 8 + length]
        at += 12 + length
    return found


SIDE = 192  # pixels
STROKE = 1.5  # half the line's width, pixels
COLOR = (0.36, 0.67, 0.95)  # sRGB
GRID = (0.5, 0.5, 0.5, 0.25)
MARGIN = 8  # pixels
MOST_POINTS = SIDE // 4  # the loss of one step jumps with its frames: what counts is how the runs of steps go


def curve(values: Sequence[float], side: int = SIDE) -> NDArray[np.float32]:
    """Draw ``values`` against their order, from their least to their greatest, as (side, side, 4) sRGB and alpha.

    Colors are premultiplied with alpha, as Blender draws its icons. Row 0 is at the top. Values that are not finite
    are left out; many are drawn by the means of equal runs of them.
    """
    picture = np.zeros((side, side, 4), np.float32)
    inner = side - 2 * MARGIN
    for line in np.linspace(MARGIN, side - 1 - MARGIN, 5).round().astype(int):
        picture[line, MARGIN:-MARGIN] = GRID
    points = _thinned(np.asarray(values, np.float64))
    if len(points) < 2:
        return _premultiplied(picture)
    low, high = float(points.min()), float(points.max())
    # A flat curve runs through the middle.
    level = (points - low) / (high - low) if high > low else np.full(len(points), 0.5)
    columns = np.arange(side)
    heights = np.interp((columns - MARGIN) / (inner - 1), np.linspace(0, 1, len(points)), level)
    rows = np.asarray(MARGIN + (1 - heights) * (inner - 1), np.float64)
    inside = (columns >= MARGIN) & (columns < side - MARGIN)
    _fill(picture, rows, inside)
    _stroke(picture, rows, inside)
    return _premultiplied(picture)


def _thinned(values: NDArray[np.float64]) -> NDArray[np.float64]:
    finite = values[np.isfinite(values)]
    if len(finite) <= MOST_POINTS:
        return finite
    return np.array([part.mean() for part in np.array_split(finite, MOST_POINTS)])


def _premultiplied(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    picture[:, :, :3] *= picture[:, :, 3:]
    return picture


def _fill(picture: NDArray[np.float32], rows: NDArray[np.float64], inside: NDArray[np.bool_]) -> None:
    """A faint area below the curve."""
    down = np.arange(len(picture))[:, None]
    area = (down > rows) & (down < len(picture) - MARGIN) & inside
    picture[area] = (*COLOR, 0.18)


def _stroke(picture: NDArray[np.float32], rows: NDArray[np.float64], inside: NDArray[np.bool_]) -> None:
    """The curve itself: as thick across as along, however steep."""
    down = np.arange(len(picture))[:, None]
    upper = np.minimum(rows, (rows + np.roll(rows, 1)) / 2)
    upper = np.minimum(upper, (rows + np.roll(rows, -1)) / 2)
    lower = np.maximum(rows, (rows + np.roll(rows, 1)) / 2)
    lower = np.maximum(lower, (rows + np.roll(rows, -1)) / 2)
    first, last = np.flatnonzero(inside)[[0, -1]]
    upper[[first, last]], lower[[first, last]] = rows[[first, last]], rows[[first, last]]
    beyond = np.maximum(np.maximum(upper - down, down - lower), 0)
    ink = np.clip(STROKE + 0.5 - beyond, 0, 1) * inside
    for channel, value in enumerate((*COLOR, 1.0)):
        layer = picture[:, :, channel]
        layer[...] = np.where(ink > 0, layer * (1 - ink) + value * ink, layer)
