"""Checksums beside the files they cover, in the format that ``sha256sum --check SHA256SUMS`` reads anywhere."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from pathlib import Path

from .errors import RaucaError
from .files import write_bytes
from .reading import read_text

SUMS_FILE = "SHA256SUMS"
MAX_SUMS_BYTES = 2**20
"""A folder of ours holds some ten files, of 80 bytes a line."""
_LINE = re.compile(r"([0-9a-f]{64})  (\S.*)")


def file_digest(path: Path) -> str:
    """SHA-256 of a file, 64 hexadecimal digits."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def write_sums(folder: Path, names: Iterable[str]) -> None:
    """Write ``folder/SHA256SUMS`` for files ``names`` relative to ``folder``; the same files give the same bytes."""
    lines = (f"{file_digest(Path(folder) / name)}  {name}\n" for name in sorted(names))
    write_bytes(Path(folder) / SUMS_FILE, "".join(lines).encode())


def read_sums(folder: Path) -> dict[str, str]:
    """Digest by file name.

    Raises:
        RaucaError: there is no such file, or it is damaged.
    """
    path = Path(folder) / SUMS_FILE
    if not path.exists():
        raise RaucaError(f"{path}: not found; what it covered cannot be verified")
    found = [_LINE.fullmatch(line) for line in read_text(path, MAX_SUMS_BYTES).splitlines()]
    if not found or not all(found):
        raise RaucaError(f"{path}: damaged, not lines of digest and name")
    sums = {match[2]: match[1] for match in found if match}
    outside = [name for name in sums if Path(name).is_absolute() or ".." in Path(name).parts]
    if outside:
        raise RaucaError(f"{path}: names {outside[0]!r}, which lies outside its folder")
    return sums


def seal_dataset(folder: Path) -> None:
    """Write the checksums of a data set's plan and vehicle, once: both stay as first written."""
    if not (Path(folder) / SUMS_FILE).is_file():
        vehicle = sorted(path.name for path in (Path(folder) / "vehicle").iterdir())
        write_sums(folder, ["dataset.json", *(f"vehicle/{name}" for name in vehicle)])
