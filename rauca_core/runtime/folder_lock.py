"""One run per folder: a second process that would write into it is refused, or waits, and hears the first one's number.

The kernel keeps the lock and lets go of it when its holder dies, however that happens, so none is ever stale. It is a
POSIX record lock, which network file systems carry between machines; a child process does not inherit it.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

from ..contract import RaucaError
from ..contract.files import disk_errors, open_to_append
from ..contract.reading import parse_json
from ..contract.schema import Fields

LOCK_FILE = ".lock"


@contextlib.contextmanager
def alone_in(folder: Path, name: str = LOCK_FILE, wait: Callable[[str], None] | None = None) -> Iterator[None]:
    """Hold ``folder``, which is created if need be, against other processes that ask for it the same way.

    A folder that is still empty afterwards is removed again. Where the system has no such locks (Windows), nothing
    is held.

    Args:
        name: of the lock's file; locks of two names do not meet.
        wait: wait for another process to end, and first tell who it is; refuse if None.

    Raises:
        RaucaError: another process holds it, and is named; or it cannot be written to.
    """
    folder = Path(folder)
    handle = _hold(folder, name, wait)
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            (folder / name).unlink()  # while it is still held: who has it open notices in `_hold`
        if handle is not None:
            os.close(handle)
        with contextlib.suppress(OSError):
            folder.rmdir()


def _hold(folder: Path, name: str, wait: Callable[[str], None] | None) -> int | None:
    """The locked file, and not one that its last holder has removed meanwhile; None without locks."""
    try:
        import fcntl
    except ImportError:
        return None
    path = folder / name
    while True:
        with disk_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
            handle = open_to_append(path)
        try:
            try:
                fcntl.lockf(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except (BlockingIOError, PermissionError):
                if wait is None:
                    raise
                wait(_holder(handle))
                fcntl.lockf(handle, fcntl.LOCK_EX)
            if path.is_file() and os.fstat(handle).st_ino == path.stat().st_ino:
                with disk_errors(folder):
                    os.ftruncate(handle, 0)
                    os.pwrite(handle, json.dumps({"pid": os.getpid(), "host": socket.gethostname()}).encode(), 0)
                return handle
        except (BlockingIOError, PermissionError):
            told = f"{folder}: {_holder(handle)} is at work here; wait for it, stop it, or choose another folder"
            os.close(handle)
            raise RaucaError(told) from None
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _holder(handle: int) -> str:
    """Who wrote the note in the lock file."""
    with contextlib.suppress(RaucaError):
        note = Fields(parse_json(os.pread(handle, 1 << 12, 0), LOCK_FILE), LOCK_FILE)
        return f"process {note.integer('pid')} on {note.plain_name('host')}"
    return "another process"
