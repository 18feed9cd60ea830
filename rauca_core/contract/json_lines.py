"""Files of JSON lines that a job appends to: ledgers, rounds, detections.

A kill cuts off the line in flight; :func:`~.files.append_line` ends it before the next, so that it spoils no other.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from .errors import RaucaError
from .files import write_bytes
from .reading import parse_json, read_limited
from .schema import Fields

T = TypeVar("T")


def whole_lines(path: Path, limit: int, kind: str, read: Callable[[Fields], T], mend: bool = False) -> list[T]:
    """What ``read`` makes of every whole line, in the file's order.

    Passed over are lines that are no JSON object and those to which ``read`` raises :class:`RaucaError`.

    Args:
        limit, kind: as of :func:`~.reading.read_limited`.
        mend: write the file anew without the lines that were passed over.

    Raises:
        RaucaError: the file itself cannot be read.
    """
    lines = read_limited(path, limit, kind).splitlines()
    whole, found = [], []
    for line in lines:
        with contextlib.suppress(RaucaError):
            found.append(read(Fields(parse_json(line, path.name), path.name)))
            whole.append(line)
    if mend and whole != lines:
        write_bytes(path, b"".join(line + b"\n" for line in whole))
    return found
