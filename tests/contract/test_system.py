"""Holds, signals and processes on this system, and the Windows branch against a stand-in for its locks and signals."""

from __future__ import annotations

import builtins
import importlib.util
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from rauca_core.contract import system

HOLDS = "import sys; from pathlib import Path; from rauca_core.contract.system import hold\n"
HOLDS += "print(hold(Path(sys.argv[1])) is not None, flush=True); sys.stdin.read()"


def test_a_held_file_is_free_when_its_holder_dies(tmp_path: Path) -> None:
    path = tmp_path / "held"
    command = [sys.executable, "-c", HOLDS, str(path)]
    other = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert other.stdout is not None
    assert other.stdout.readline().strip() == "True"
    assert system.hold(path) is None
    other.kill()
    other.communicate()
    handle = system.hold(path)
    assert handle is not None
    assert system.hold(path) is None
    system.let_go(handle)
    assert system.hold(path) is not None


def test_a_killed_process_is_told_by_its_signal() -> None:
    code = subprocess.run([sys.executable, "-c", "import os; os.kill(os.getpid(), 9)"], check=False).returncode
    assert system.killed_by(code) == "SIGKILL"
    assert system.killed_by(3) == ""


class Locks(ModuleType):
    """``msvcrt`` as far as it is used: a lock of a byte belongs to one handle of a file."""

    LK_NBLCK = 2

    def __init__(self) -> None:
        super().__init__("msvcrt")
        self.holders: dict[int, int] = {}

    def locking(self, handle: int, mode: int, count: int) -> None:
        assert (mode, count) == (self.LK_NBLCK, 1)
        file = os.fstat(handle).st_ino
        holder = self.holders.get(file)
        if holder not in (None, handle) and _is_open(holder, file):
            raise OSError(36, "Resource deadlock avoided")
        self.holders[file] = handle


def _is_open(handle: int | None, file: int) -> bool:
    try:
        return handle is not None and os.fstat(handle).st_ino == file
    except OSError:
        return False


@pytest.fixture
def windows(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module as Windows loads it: without fcntl, with msvcrt."""
    real = builtins.__import__

    def without_fcntl(name: str, *given: object, **more: object) -> ModuleType:
        if name == "fcntl":
            raise ImportError(name)
        return real(name, *given, **more)  # type: ignore[arg-type]

    spec = importlib.util.spec_from_file_location("system_on_windows", Path(system.__file__))
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    with monkeypatch.context() as there:
        there.setitem(sys.modules, "msvcrt", Locks())
        there.setattr(builtins, "__import__", without_fcntl)
        spec.loader.exec_module(loaded)
    return loaded


def test_windows_holds_files_and_no_ranges(windows: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "held"
    handle = windows.hold(path)
    assert handle is not None
    assert windows.hold(path) is None
    windows.let_go(handle)
    assert windows.hold(path) is not None
    assert not windows.has_range_locks()
    assert windows.lock_range(0, 0, 5)
    windows.unlock_range(0, 0, 5)
    windows.flush(tmp_path)  # a folder cannot be opened there


def test_windows_asks_a_group_to_end_and_kills_it_when_it_does_not(
    windows: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[object] = []

    def wait(timeout: float) -> None:
        raise subprocess.TimeoutExpired("child", timeout)

    child = SimpleNamespace(pid=7, send_signal=done.append, poll=lambda: None, wait=wait)
    monkeypatch.setattr(subprocess, "run", lambda command, **more: done.append(command))
    windows.end_all(child, 0.1)
    assert done == [getattr(signal, "CTRL_BREAK_EVENT", 1), ["taskkill", "/F", "/T", "/PID", "7"]]
    assert windows.own_session() == {"creationflags": 0x200}
    assert {signal.SIGINT, signal.SIGTERM} <= set(windows.stop_signals())
    assert windows.killed_by(0xC0000005) == "SIGSEGV"
    assert windows.killed_by(2) == ""
    assert windows.python_in(Path("made")) == Path("made/Scripts/python.exe")


def test_only_this_module_asks_for_posix() -> None:
    """Else the add-on would not even load on Windows."""
    root = Path(system.__file__).parents[2]
    asked = ("import fcntl", "os.killpg", "start_new_session", "signal.SIGKILL", "os.pread", "sched_getaffinity")
    rooms = ("blender_addon", "rauca_core/contract", "rauca_core/geometry", "rauca_core/runtime", "pipelines")
    found = [
        f"{path.relative_to(root)}: {word}"
        for room in rooms
        for path in (root / room).rglob("*.py")
        if path != Path(system.__file__)
        for word in asked
        if word in path.read_text(encoding="utf-8")
    ]
    assert found == []
