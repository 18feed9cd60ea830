"""Opening files that somebody else wrote: only regular files, never more bytes than a limit, JSON that cannot bite.

Every reader of the house begins here, so a pipe or a device behind a link cannot hang it, and a file cannot take
more memory than its reader's limit lets it.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from .errors import RaucaError

MAX_JSON_DEPTH = 64
"""The deepest file of ours nests ten levels; recursive code (``json.dumps``, ``==``) fails at some hundreds."""


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
        raise RaucaError(f"{path}: refers to {named[:80]!r}, which is no path") from error
    if not found.is_relative_to(folder):
        raise RaucaError(f"{path}: refers to {named[:80]!r} outside its folder; bring the files together")
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
    level = [value]
    for _ in range(MAX_JSON_DEPTH):
        level = [inner for outer in level for inner in _inside(outer) if isinstance(inner, dict | list)]
        if not level:
            return value
    raise RaucaError(f"{where}: not valid JSON (nested more than {MAX_JSON_DEPTH} levels deep)")


def _inside(value: Any) -> Any:
    if isinstance(value, dict):
        return value.values()
    return value if isinstance(value, list) else ()
