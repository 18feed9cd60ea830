"""Writes that either happen whole or not at all.

A file or folder is written under a temporary name beside its target, flushed to the disk, then renamed: a reader,
or a job that resumes after a crash, never meets half of one.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import re
import shutil
import stat
import struct
import tempfile
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import RaucaError
from .reading import read_text
from .system import flush, read_at

TEMPORARY_PREFIX = ".partial-"


_FULL = "no space left on the disk; free some and run the same command again"
_NOT_WRITABLE = "not writable; choose another output folder"
_REFUSALS = {
    errno.ENOSPC: _FULL,
    errno.EDQUOT: _FULL,
    errno.EACCES: _NOT_WRITABLE,
    errno.EPERM: _NOT_WRITABLE,
    errno.EROFS: _NOT_WRITABLE,
    errno.EFBIG: "larger than files may be here; raise the limit (`ulimit -f`) or choose another disk, and run the "
    "same command again",
    errno.EIO: "the disk fails (input/output error); choose another one",
}


@contextlib.contextmanager
def disk_errors(target: Path) -> Iterator[None]:
    """Turn the disk's refusals into a :class:`RaucaError` that names ``target``."""
    try:
        yield
    except OSError as error:
        if error.errno not in _REFUSALS:
            raise
        raise RaucaError(f"{_lasting(target)}: {_REFUSALS[error.errno]}") from error


def require_space(folder: Path, needed_bytes: int) -> None:
    """Raise :class:`RaucaError` if the disk that will hold ``folder`` has less than ``needed_bytes`` free."""
    existing = folder.absolute()
    while not existing.exists():
        existing = existing.parent
    free = shutil.disk_usage(existing).free
    if free < needed_bytes:
        raise RaucaError(
            f"{folder}: needs about {needed_bytes / 2**20:.0f} MiB but the disk has {free / 2**20:.0f} MiB free; "
            "free some space or choose another output folder"
        )


def write_bytes(path: Path, data: bytes) -> None:
    """Write ``data`` to ``path`` atomically, creating its folder."""
    path = Path(path)
    with disk_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=TEMPORARY_PREFIX, dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(data)
                stream.flush()
                os.fsync(stream.fileno())
            os.chmod(temporary, 0o644)
            os.replace(temporary, path)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
            raise


def write_json(path: Path, value: Any) -> None:
    """Write ``value`` as UTF-8 JSON atomically; NaN and infinity are refused, JSON has none."""
    write_bytes(path, (json.dumps(value, indent=1, allow_nan=False) + "\n").encode())


@contextlib.contextmanager
def atomic_folder(target: Path) -> Iterator[Path]:
    """Yield a temporary folder that becomes ``target`` on success and vanishes on any exception.

    An existing ``target`` is replaced only once the new one is complete.
    """
    target = Path(target)
    with disk_errors(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=TEMPORARY_PREFIX, dir=target.parent))
        try:
            yield temporary
            for entry in temporary.rglob("*"):
                flush(entry)
            os.chmod(temporary, 0o755)
            if target.exists():
                shutil.rmtree(target)
            os.replace(temporary, target)
            flush(target.parent)
        except BaseException:
            shutil.rmtree(temporary, ignore_errors=True)
            raise


def sweep_partials(folder: Path) -> None:
    """Remove what a killed job left under a temporary name directly inside ``folder``."""
    for entry in list(Path(folder).glob(TEMPORARY_PREFIX + "*")):
        if entry.is_dir():
            shutil.rmtree(entry, ignore_errors=True)
        else:
            entry.unlink(missing_ok=True)


def open_to_append(path: Path) -> int:
    """Handle of a file that is read and appended to in place, created if need be.

    Never through a link, unlike what is only read: a folder that somebody else made could have one that leads to any
    file of the user's.

    Raises:
        RaucaError: a link, a folder, a pipe or a device is there.
        OSError: see :func:`disk_errors`.
    """
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0), 0o644)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.EISDIR, errno.ENXIO, errno.ENODEV):
            raise RaucaError(f"{path}: is no file of this folder (a link, a folder or a device); remove it") from error
        raise
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise RaucaError(f"{path}: is no file of this folder (a pipe or a device); remove it")
    return handle


def append_line(path: Path, line: str) -> None:
    """Append one line to a ledger, with a single write where the disk has room, then flush it to the disk.

    A line that a crash cut off is ended first, so that it spoils no other. Raises as :func:`open_to_append`.
    """
    with disk_errors(path):
        handle = open_to_append(path)
        try:
            size = os.fstat(handle).st_size
            cut = size > 0 and read_at(handle, 1, size - 1) != b"\n"
            data = ("\n" * cut + line + "\n").encode()
            while data:  # a disk that is filling up takes a part of it, and refuses the rest
                data = data[os.write(handle, data) :]
            os.fsync(handle)
        finally:
            os.close(handle)


def png_bytes(pixels: NDArray[np.uint8]) -> bytes:
    """Encode (H, W) grey or (H, W, 3) RGB 8-bit pixels as PNG.

    Blender's Python has neither Pillow nor OpenCV, and Blender's own image writer applies color management: hence
    these few lines. Reading is left to Pillow (outside Blender) and to Blender (inside).
    """
    if pixels.dtype != np.uint8 or pixels.ndim not in (2, 3) or (pixels.ndim == 3 and pixels.shape[2] != 3):
        raise ValueError(f"PNG needs uint8 (H, W) or (H, W, 3) pixels, not {pixels.dtype} {pixels.shape}")
    height, width = pixels.shape[:2]
    rows = np.ascontiguousarray(pixels).reshape(height, -1)
    filtered = np.zeros((height, rows.shape[1] + 1), np.uint8)
    filtered[:, 1:] = rows

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", width, height, 8, 0 if pixels.ndim == 2 else 2, 0, 0, 0)
    body = zlib.compress(filtered.tobytes(), 6)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


def _lasting(target: Path) -> Path:
    """What of a path the reader of a message will find: files under a temporary name are gone by then."""
    for path in (target, *target.parents):
        if path.name.startswith(TEMPORARY_PREFIX):
            return path.parent
    return target


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
