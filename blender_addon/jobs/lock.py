"""One supervisor per camera: shards that do not overlap may share a folder, anything else is refused.

The kernel keeps the locks and lets go of them when their holder dies, so none is ever stale; they are POSIX record
locks, which network file systems carry between machines. Byte ``c`` of the lock file stands for camera ``c``.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path

from ..core import contract, files, reading, schema

LOCK_FILE = ".lock"
CLAIM = 1 << 40  # the byte that guards the writing of the plan; no camera has this number
PATIENCE_S = 5.0  # a neighbor that looks around holds everything for an instant


class FolderLock:
    """Cameras of a data set folder that this process alone may render."""

    def __init__(self, folder: Path, handle: int, first: int, end: int) -> None:
        self._folder, self._handle, self._first, self._end = folder, handle, first, end

    @contextlib.contextmanager
    def claiming(self) -> Iterator[None]:
        """Within: no other process writes the folder's plan or vehicle."""
        fcntl.lockf(self._handle, fcntl.LOCK_EX, 1, CLAIM)
        try:
            yield
        finally:
            fcntl.lockf(self._handle, fcntl.LOCK_UN, 1, CLAIM)

    def sweep(self) -> None:
        """Remove what killed jobs left half-written, unless another shard is at work and may be writing it."""
        if not _try_lock(self._handle, 0, CLAIM):
            return
        with self.claiming():  # a shard that has no camera to lock may be writing the vehicle
            files.sweep_partials(self._folder)
        files.sweep_partials(self._folder / "frames")
        if self._first:
            fcntl.lockf(self._handle, fcntl.LOCK_UN, self._first, 0)
        fcntl.lockf(self._handle, fcntl.LOCK_UN, CLAIM - self._end, self._end)


@contextlib.contextmanager
def hold_cameras(folder: Path, shard: contract.Shard, cameras: tuple[int, int]) -> Iterator[FolderLock]:
    """Lock cameras ``first`` up to ``end`` of a data set ``folder``, which is created if need be.

    A folder that is still empty afterwards is removed again.

    Raises:
        RaucaError: another process renders some of them; the message names it.
    """
    first, end = cameras
    with files.disk_errors(folder):
        handle = _open(folder)
    try:
        _lock_or_refuse(folder, handle, shard, first, end)
        yield FolderLock(folder, handle, first, end)
    finally:
        # The last one to leave removes the file; whoever has it open notices in `_open`.
        if _try_lock(handle, 0, 0):
            (folder / LOCK_FILE).unlink(missing_ok=True)
        os.close(handle)
        with contextlib.suppress(OSError):
            folder.rmdir()


def _open(folder: Path) -> int:
    """The lock file, and not one that its last holder removed meanwhile."""
    path = folder / LOCK_FILE
    while True:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError) as error:
            raise contract.RaucaError(f"{error.filename}: is a file; choose another output folder") from error
        try:
            handle = files.open_to_append(path)
        except FileNotFoundError:
            continue
        fcntl.lockf(handle, fcntl.LOCK_EX, 1, CLAIM)
        with contextlib.suppress(FileNotFoundError):
            if os.fstat(handle).st_ino == path.stat().st_ino:
                fcntl.lockf(handle, fcntl.LOCK_UN, 1, CLAIM)
                return handle
        os.close(handle)


def _lock_or_refuse(folder: Path, handle: int, shard: contract.Shard, first: int, end: int) -> None:
    if first == end:
        return  # more shards than cameras: nothing to guard, and a length of 0 would mean everything
    deadline = time.monotonic() + PATIENCE_S
    while not _try_lock(handle, first, end - first):
        if time.monotonic() > deadline:
            raise contract.RaucaError(
                f"{folder}: is being rendered by {_holder(handle, first, end)}; wait for it, stop it, or take a shard "
                "that does not overlap"
            )
        time.sleep(0.1)
    note = {"pid": os.getpid(), "host": socket.gethostname(), "shard": str(shard), "first": first, "end": end}
    os.write(handle, (json.dumps(note) + "\n").encode())


def _holder(handle: int, first: int, end: int) -> str:
    """Who holds cameras in question, from the newest note in the lock file whose lock is still there."""
    text = os.pread(handle, 1 << 20, 0).decode(errors="replace")
    for line in reversed(text.splitlines()):
        with contextlib.suppress(contract.RaucaError):
            note = schema.Fields(reading.parse_json(line, LOCK_FILE), LOCK_FILE)
            begin, stop = note.integer("first", maximum=CLAIM), note.integer("end", maximum=CLAIM)
            if max(begin, first) < min(stop, end) and not _is_free(handle, begin, stop - begin):
                shard = note.text("shard")
                part = f" (shard {shard})" if shard != "1/1" and shard.isprintable() else ""
                return f"process {note.integer('pid')} on {note.plain_name('host')}{part}"
    return "another process"


def _is_free(handle: int, start: int, length: int) -> bool:
    if not _try_lock(handle, start, length):
        return False
    fcntl.lockf(handle, fcntl.LOCK_UN, length, start)
    return True


def _try_lock(handle: int, start: int, length: int) -> bool:
    try:
        fcntl.lockf(handle, fcntl.LOCK_EX | fcntl.LOCK_NB, length, start)
    except (BlockingIOError, PermissionError):
        return False
    return True
