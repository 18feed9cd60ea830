"""What tests do to a small disk."""

from __future__ import annotations

import contextlib
from pathlib import Path


def fill(disk: Path) -> None:
    """Leave no byte free."""
    with (disk / "filler").open("wb", buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(4096))
