"""Opening files that somebody else wrote: only regular files, never more bytes than a limit, JSON that cannot bite.

Every reader of the house begins here, so a pipe or a device behind a link cannot hang it, and a file cannot take
more memory than its reader's limit lets it.
"""

from __future__ import annotations

import json
import os
import struct
import zipfile
import zlib
from pathlib import Path
from typing import Any

from .errors import RaucaError

# The last two: a flipped bit makes it seem encrypted, or packed in another way. ValueError: a name that is no UTF-8.
DAMAGED_ARCHIVE = (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError)
"""What ``zipfile`` raises of an archive with flipped or missing bytes."""
MAX_JSON_DEPTH = 64
"""The deepest file of ours nests ten levels; recursive code (``json.dumps``, ``==``) fails at some hundreds."""
MAX_PIXELS = 8192 * 8192
"""Of a PNG or JPEG, asked before it is decoded: Blender would take the memory first. Frames and UV
maps are no larger; Blender holds 4 or 16 bytes for each, whatever the file's own size is."""
HEADER_BYTES = 2**20
"""A JPEG's size stands behind its metadata, which is rarely longer."""
_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"
_NO_FRAME = {0xC4, 0xC8, 0xCC}  # tables and reserved markers among those that begin a frame


def require_file(path: Path) -> None:
    """Raise :class:`RaucaError` unless a regular file is there: opening a pipe waits, reading a device never ends."""
    # os.path: a name too long for any disk is one that is not there, where Path raises OSError
    if not os.path.isfile(path):
        told = "cannot be read (it is no regular file)" if os.path.exists(path) else "not found"
        raise RaucaError(f"{path}: {told}")


def read_limited(path: Path, limit: int, kind: str = "a file of this project") -> bytes:
    """All bytes of a regular file.

    Args:
        limit: bytes; a larger file is not read.
        kind: what the file should be, for the message.

    Raises:
        RaucaError: missing, no regular file (a folder, pipe or device), larger than ``limit``, or unreadable.
    """
    path = Path(path)
    require_file(path)
    try:
        with path.open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            if size > limit:
                raise RaucaError(f"{path}: larger than {limit / 2**20:.3g} MiB, not {kind}")
            return stream.read(size)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise RaucaError(f"{path}: cannot be read ({reason})") from error


def read_text(path: Path, limit: int, kind: str = "a file of this project") -> str:
    """All of a UTF-8 text file; raises as :func:`read_limited`, and for bytes that are no text."""
    try:
        return read_limited(path, limit, kind).decode("utf-8")
    except UnicodeDecodeError as error:
        raise RaucaError(f"{path}: cannot be read as text ({error})") from error


def require_inside(path: Path, named: str) -> Path:
    """The file that ``path`` refers to as ``named``, links followed.

    Raises:
        RaucaError: it lies outside the folder of ``path``.
    """
    folder = Path(path).parent.resolve()
    try:
        found = (folder / named).resolve()
    except (OSError, ValueError, RuntimeError) as error:  # no path at all, or links in a circle
        raise RaucaError(f"{path}: refers to {named[:200]!r}, which is no path") from error
    if not found.is_relative_to(folder):
        raise RaucaError(f"{path}: refers to {named[:200]!r} outside its folder; bring the files together")
    return found


def parse_json(text: str | bytes, where: str) -> Any:
    """A JSON value.

    Raises:
        RaucaError: not JSON, a number of more digits than Python reads, or nested deeper than :data:`MAX_JSON_DEPTH`.
    """
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RaucaError(f"{where}: not valid JSON ({error})") from error
    level: list[Any] = [[value]]
    for _ in range(MAX_JSON_DEPTH + 1):
        inside = (inner for outer in level for inner in (outer.values() if isinstance(outer, dict) else outer))
        level = [inner for inner in inside if isinstance(inner, dict | list)]
        if not level:
            return value
    raise RaucaError(f"{where}: not valid JSON (nested more than {MAX_JSON_DEPTH} levels deep)")


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
