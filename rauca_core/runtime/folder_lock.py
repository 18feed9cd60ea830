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
from pathlib import Path

from ..contract import RaucaError
from ..contract.files import disk_errors, open_to_append
from ..contract.reading import parse_json
from ..contract.schema import Fields

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
            _lock(self._handle, EVERYTHING, 1, wait=True)
        try:
            yield
        finally:
            if self._handle is not None:
                _unlock(self._handle, EVERYTHING, 1)

    @contextlib.contextmanager
    def nobody_else(self) -> Iterator[bool]:
        """Within: no other process holds any range, if the value is True."""
        if self._handle is None or not _lock(self._handle, 0, EVERYTHING):
            yield self._handle is None
            return
        try:
            yield True
        finally:
            if self._first:
                _unlock(self._handle, 0, self._first)
            _unlock(self._handle, self._end, EVERYTHING - self._end)


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
    folder = Path(folder)
    handle = _hold(folder, name, (first, end), label, refusal, wait, patience_s)
    try:
        yield HeldRange(handle, first, end)
    finally:
        if handle is not None:
            # The last one to leave removes the file, while it holds everything; who has it open notices in `_hold`.
            if _lock(handle, 0, 0):
                (folder / name).unlink(missing_ok=True)
            os.close(handle)
        with contextlib.suppress(OSError):
            folder.rmdir()


def _hold(
    folder: Path,
    name: str,
    wanted: tuple[int, int],
    label: str,
    refusal: str,
    wait: Callable[[str], None] | None,
    patience_s: float,
) -> int | None:
    """The lock's file with the range locked, and not a file that its last holder has removed; None without locks."""
    try:
        import fcntl  # noqa: F401 - there is none on Windows
    except ImportError:
        return None
    first, end = wanted
    deadline = time.monotonic() + patience_s
    while True:
        handle = _open(folder, name)
        try:
            if first < end and not _lock(handle, first, end - first):  # a length of 0 would mean everything
                if wait is not None:
                    wait(_holder(handle, first, end))
                    _lock(handle, first, end - first, wait=True)
                elif time.monotonic() < deadline:
                    time.sleep(0.1)
                    os.close(handle)
                    continue
                else:
                    raise RaucaError(f"{folder}: {refusal.format(who=_holder(handle, first, end))}")
            _lock(handle, EVERYTHING, 1, wait=True)
            if _is_still_there(handle, folder / name):
                with disk_errors(folder):
                    _sign(handle, first, end, label)
                _unlock(handle, EVERYTHING, 1)
                return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _open(folder: Path, name: str) -> int:
    while True:
        with disk_errors(folder):
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except (FileExistsError, NotADirectoryError) as error:
                raise RaucaError(f"{error.filename}: is a file; choose another output folder") from error
            with contextlib.suppress(FileNotFoundError):  # its last holder has just removed the folder
                return open_to_append(folder / name)


def _is_still_there(handle: int, path: Path) -> bool:
    try:
        return os.fstat(handle).st_ino == path.stat().st_ino
    except FileNotFoundError:
        return False


def _sign(handle: int, first: int, end: int, label: str) -> None:
    """Leave a note of who holds the range."""
    if first == 0 and end == EVERYTHING:
        os.ftruncate(handle, 0)  # nobody else's note is true
    note = {"pid": os.getpid(), "host": socket.gethostname(), "label": label, "first": first, "end": end}
    os.write(handle, (json.dumps(note) + "\n").encode())


def _holder(handle: int, first: int, end: int) -> str:
    """Who holds things in question, from the newest note in the lock's file whose lock is still there."""
    text = os.pread(handle, 1 << 20, 0).decode(errors="replace")
    for line in reversed(text.splitlines()):
        with contextlib.suppress(RaucaError):
            note = Fields(parse_json(line, LOCK_FILE), LOCK_FILE)
            begin, stop = note.integer("first", maximum=EVERYTHING), note.integer("end", maximum=EVERYTHING)
            if max(begin, first) < min(stop, end) and not _is_free(handle, begin, stop - begin):
                label = note.text("label")
                part = f" ({label})" if label and label.isprintable() else ""
                return f"process {note.integer('pid')} on {note.plain_name('host')}{part}"
    return "another process"


def _is_free(handle: int, start: int, length: int) -> bool:
    if not _lock(handle, start, length):
        return False
    _unlock(handle, start, length)
    return True


def _lock(handle: int, start: int, length: int, wait: bool = False) -> bool:
    """Lock bytes; False where another process has some and we do not wait. A length of 0 means all that follow."""
    import fcntl

    try:
        fcntl.lockf(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB), length, start)
    except (BlockingIOError, PermissionError):
        return False
    return True


def _unlock(handle: int, start: int, length: int) -> None:
    import fcntl

    fcntl.lockf(handle, fcntl.LOCK_UN, length, start)
