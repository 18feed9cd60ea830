"""What differs between POSIX systems and Windows, in one place: locks of files, process groups, signals, flushing.

The Windows branches follow its documentation and are tested against stand-ins; nobody has run them on Windows.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

try:
    import fcntl
except ImportError:  # Windows
    import msvcrt

    fcntl = None  # type: ignore[assignment]

# What Windows reports of a process that its kernel ended, by the names of POSIX signals for the same.
STATUSES = {0xC0000005: "SIGSEGV", 0xC000001D: "SIGILL", 0xC0000094: "SIGFPE", 0xC0000017: "SIGKILL"}


def hold(path: Path) -> int | None:
    """Lock a file, created if need be, until :func:`let_go` or this process's end; None where another one holds it."""
    handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        if fcntl is not None:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        else:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    except OSError:
        os.close(handle)
        return None
    return handle


def let_go(handle: int) -> None:
    """End a hold."""
    os.close(handle)


def lock_range(handle: int, start: int, length: int, wait: bool = False) -> bool:
    """Lock bytes; False where another process has some and we do not wait. A length of 0 means all that follow.

    Windows has no locks that leave the bytes readable to others: nothing is held there.
    """
    if fcntl is None:
        return True
    try:
        fcntl.lockf(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB), length, start)
    except (BlockingIOError, PermissionError):
        return False
    return True


def unlock_range(handle: int, start: int, length: int) -> None:
    """End a lock of bytes."""
    if fcntl is not None:
        fcntl.lockf(handle, fcntl.LOCK_UN, length, start)


def has_range_locks() -> bool:
    """Whether :func:`lock_range` holds anything."""
    return fcntl is not None


def own_session() -> dict[str, Any]:
    """Arguments of ``subprocess.Popen`` for a child that Ctrl-C in its parent's terminal does not reach."""
    if fcntl is not None:
        return {"start_new_session": True}
    return {"creationflags": getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0x200)}


def ask_to_end(process: subprocess.Popen[Any]) -> None:
    """Ask a child with a session of its own to end at the next good moment; what it started itself is not asked."""
    with contextlib.suppress(OSError):
        if fcntl is not None:
            process.terminate()
        else:  # terminate() would end it at once there
            process.send_signal(getattr(signal, "CTRL_BREAK_EVENT", 1))


def end_all(process: subprocess.Popen[Any], patience_s: float) -> None:
    """Ask a child with a session of its own, and what it has started, to end; end them if that takes too long."""
    if process.poll() is not None:
        return
    if fcntl is None:
        ask_to_end(process)  # reaches its whole group
    else:
        os.killpg(process.pid, signal.SIGTERM)
    try:
        process.wait(timeout=patience_s)
    except subprocess.TimeoutExpired:
        if fcntl is None:
            subprocess.run(["taskkill", "/F", "/T", "/PID", str(process.pid)], capture_output=True, check=False)
        else:
            os.killpg(process.pid, signal.SIGKILL)


def stop_signals() -> tuple[signal.Signals, ...]:
    """The signals that ask this process to end: of Ctrl-C, and of :func:`ask_to_end`."""
    asked = (signal.SIGINT, signal.SIGTERM)
    return asked if fcntl is not None else (*asked, signal.Signals(getattr(signal, "SIGBREAK", signal.SIGTERM)))


def killed_by(code: int) -> str:
    """The name of the signal that ended a process, from its exit code; empty if it ended by itself."""
    if code < 0:
        return signal.Signals(-code).name
    return "" if fcntl is not None else STATUSES.get(code, "")


def read_at(handle: int, length: int, start: int) -> bytes:
    """Bytes of a file that is otherwise only appended to."""
    if hasattr(os, "pread"):
        return os.pread(handle, length, start)
    os.lseek(handle, start, os.SEEK_SET)
    return os.read(handle, length)


def flush(path: Path) -> None:
    """Write a file, or a folder's entries, to the disk; Windows opens no folders, and keeps their entries by itself."""
    if fcntl is None and path.is_dir():
        return
    handle = os.open(path, os.O_RDONLY if fcntl is not None else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_blender(code: str, job: Path, program: str = "", threads: int = 0) -> list[str]:
    """The command that runs Python code on a job's file in Blender, without a window.

    Blender counts the cores once, for its pool of threads (oneTBB). What is left over of a larger pool waits for the
    thread that renders by asking again and again, and takes up to two fifths of the time from the process beside it.

    Args:
        program: Blender's; this Python with the bpy wheel if it is empty.
        threads: of Blender; 0: as many as there are cores.
    """
    if program:
        limit = ["-t", str(threads)] if threads else []
        return [program, "-b", *limit, "--python-exit-code", "3", "--python-expr", code, "--", str(job)]
    if threads and hasattr(os, "sched_setaffinity"):  # the wheel has no option: it is loaded as if there were few cores
        few = f"os.sched_setaffinity(0, sorted(cores)[:{threads}])"
        load = f"import os; cores = os.sched_getaffinity(0); {few}; import bpy; os.sched_setaffinity(0, cores); "
        code = load + code
    return [sys.executable, "-c", code, str(job)]


def python_in(environment: Path) -> Path:
    """The program of a virtual environment."""
    return environment / ("bin/python" if fcntl is not None else "Scripts/python.exe")
