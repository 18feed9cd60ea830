"""Small pictures from the PNG files that rauca itself writes; no Blender, so a thread may read them.

Blender's own loaders would add images to the user's file or fill the desktop's thumbnail cache.
"""

from __future__ import annotations

import struct
import zlib
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
