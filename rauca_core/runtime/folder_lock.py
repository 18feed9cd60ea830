"""Who may write into a folder: one process, or several of which each holds a range of its own, such as cameras.

The kernel keeps the lock and lets go of it when its holder dies, however that happens, so none is ever stale. It is a
POSIX record lock, which network file systems carry between machines; a child process does not inherit it. Byte ``n`` of
the lock's file stands for the n-th thing in the folder. Without torch: the extension has it.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from ..contract import RaucaError
from ..contract.files import disk_errors, open_to_append
from ..contract.reading import parse_json
from ..contract.schema import Fields, Record
from ..contract.system import has_range_locks, lock_range, read_at, unlock_range

LOCK_FILE = ".lock"
EVERYTHING = 1 << 40  # more things than any folder has; this byte guards the opening of the file, and shared writing
ALONE = "{who} is at work here; wait for it, stop it, or choose another folder"


class HeldRange:
    """Things ``first`` up to ``end`` of a folder that this process alone may write."""

    def __init__(self, handle: int | None, first: int, end: int) -> None:
        self._handle, self._first, self._end = handle, first, end

    @contextlib.contextmanager
    def shared_writing(self) -> Iterator[None]:
        """Within: no other holder writes what belongs to all of them."""
        if self._handle is not None:
            lock_range(self._handle, EVERYTHING, 1, wait=True)
        try:
            yield
        finally:
            if self._handle is not None:
                unlock_range(self._handle, EVERYTHING, 1)

    @contextlib.contextmanager
    def nobody_else(self) -> Iterator[bool]:
        """Within: no other process holds any range, if the value is True."""
        if self._handle is None or not lock_range(self._handle, 0, EVERYTHING):
            yield self._handle is None
            return
        try:
            yield True
        finally:
            if self._first:
                unlock_range(self._handle, 0, self._first)
            unlock_range(self._handle, self._end, EVERYTHING - self._end)


@contextlib.contextmanager
def alone_in(folder: Path, name: str = LOCK_FILE, wait: Callable[[str], None] | None = None) -> Iterator[None]:
    """Hold all of ``folder``, which is created if need be, against other processes that ask for it the same way.

    A folder that is still empty afterwards is removed again. Where the system has no such locks (Windows), nothing
    is held.

    Args:
        name: of the lock's file; locks of two names do not meet.
        wait: wait for another process to end, and first tell who it is; refuse if None.

    Raises:
        RaucaError: another process holds it, and is named; or it cannot be written to.
    """
    with hold_range(folder, 0, EVERYTHING, name=name, wait=wait):
        yield


@contextlib.contextmanager
def hold_range(
    folder: Path,
    first: int,
    end: int,
    label: str = "",
    refusal: str = ALONE,
    name: str = LOCK_FILE,
    wait: Callable[[str], None] | None = None,
    patience_s: float = 0.0,
) -> Iterator[HeldRange]:
    """Hold things ``first`` up to ``end`` of a folder; otherwise as :func:`alone_in`.

    Args:
        label: what the holder calls its range, for those that it keeps out.
        refusal: what they are told, with the holder for ``{who}``.
        patience_s: how long to try.
    """
    path = Path(folder) / name
    handle: int | None = None
    note = _Note(os.getpid(), socket.gethostname(), label, first, end)
    deadline = time.monotonic() + patience_s
    while has_range_locks() and handle is None:
        handle, holder = _try_to_hold(path, note, wait)
        if holder and time.monotonic() >= deadline:
            raise RaucaError(f"{folder}: {refusal.format(who=holder)}")
        time.sleep(0.1 if holder else 0)
    try:
        yield HeldRange(handle, first, end)
    finally:
        if handle is not None:
            # The last one to leave removes the file, while it holds everything; who has it open notices.
            if lock_range(handle, 0, 0):
                path.unlink(missing_ok=True)
            os.close(handle)
        with contextlib.suppress(OSError):
            path.parent.rmdir()


@dataclass(frozen=True)
class _Note(Record):
    """Who holds a range, a line in the lock's file."""

    pid: int
    host: Annotated[str, "plain_name"]
    label: str
    first: Annotated[int, (0, EVERYTHING)]
    end: Annotated[int, (0, EVERYTHING)]

    def __str__(self) -> str:
        part = f" ({self.label})" if self.label and self.label.isprintable() else ""
        return f"process {self.pid} on {self.host}{part}"


def _try_to_hold(path: Path, note: _Note, wait: Callable[[str], None] | None) -> tuple[int | None, str]:
    """The lock's file with the range locked, or who holds some of it; neither where a last holder removed the file."""
    handle, length = _open(path), note.end - note.first
    try:
        if length > 0 and not lock_range(handle, note.first, length):  # a length of 0 would mean everything
            holder = _holder(handle, note.first, note.end)
            if wait is None:
                os.close(handle)
                return None, holder
            wait(holder)
            lock_range(handle, note.first, length, wait=True)
        lock_range(handle, EVERYTHING, 1, wait=True)
        if not _is_still_there(handle, path):
            os.close(handle)
            return None, ""
        with disk_errors(path.parent):
            if length == EVERYTHING:
                os.ftruncate(handle, 0)  # nobody else's note is true
            os.write(handle, (json.dumps(note.to_json()) + "\n").encode())
        unlock_range(handle, EVERYTHING, 1)
        return handle, ""
    except BaseException:
        os.close(handle)
        raise


def _open(path: Path) -> int:
    while True:
        with disk_errors(path.parent):
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
            except (FileExistsError, NotADirectoryError) as error:
                raise RaucaError(f"{error.filename}: is a file; choose another output folder") from error
            with contextlib.suppress(FileNotFoundError):  # its last holder has just removed the folder
                return open_to_append(path)


def _is_still_there(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False


def _holder(handle: int, first: int, end: int) -> str:
    """Who holds things in question, from the newest note in the lock's file whose lock is still there."""
    text = read_at(handle, 1 << 20, 0).decode(errors="replace")
    for line in reversed(text.splitlines()):
        with contextlib.suppress(RaucaError):
            note = _Note.from_json(Fields(parse_json(line, LOCK_FILE), LOCK_FILE))
            if max(note.first, first) < min(note.end, end):
                if not lock_range(handle, note.first, note.end - note.first):
                    return str(note)
                unlock_range(handle, note.first, note.end - note.first)
    return "another process"
