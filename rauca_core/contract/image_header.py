"""What a PNG or JPEG says of its size before it is decoded: Blender would take the memory first."""

from __future__ import annotations

import struct

from .errors import RaucaError

MAX_PIXELS = 8192 * 8192
"""Frames and UV maps are no larger; Blender holds 4 or 16 bytes for each, whatever the file's own size is."""
HEADER_BYTES = 2**20
"""A JPEG's size stands behind its metadata, which is rarely longer."""
_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"
_NO_FRAME = {0xC4, 0xC8, 0xCC}  # tables and reserved markers among those that begin a frame


def declared_size(header: bytes) -> tuple[int, int] | None:
    """(width, height) that the first bytes of a PNG or JPEG declare; None when they are neither, or end too early."""
    if header.startswith(_PNG) and len(header) >= 24:
        width, height = struct.unpack(">II", header[16:24])
        return width, height
    return _jpeg_size(header) if header.startswith(_JPEG) else None


def require_size(header: bytes, where: str) -> None:
    """Raise :class:`RaucaError` naming ``where`` when an image declares more than :data:`MAX_PIXELS`."""
    size = declared_size(header)
    if size is not None and size[0] * size[1] > MAX_PIXELS:
        raise RaucaError(f"{where}: {size[0]}x{size[1]} pixels; at most 8192x8192 are read")


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if 0xC0 <= marker <= 0xCF and marker not in _NO_FRAME:
            height, width = struct.unpack(">HH", data[at + 5 : at + 9])
            return width, height
        (length,) = struct.unpack(">H", data[at + 2 : at + 4])
        at += 1 if marker == 0xFF else 2 + max(length, 2)
    return None
