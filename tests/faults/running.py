"""Jobs as users start them, each a process of its own that a signal, a limit or a small disk can hit.

A server imports the command line once and forks itself for every job: a process costs the job's own work, not six
seconds of imports.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import resource
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

PATIENCE_S = 240.0
CLONE_NEWNS, CLONE_NEWUSER = 0x00020000, 0x10000000
SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload(
    [
        *("pipelines.cli", "rauca_core.study.evaluate"),
        *("rauca_core.study.defences", "rauca_core.detect.darknet", "torch.utils.tensorboard", "cv2"),
        *("numba.experimental", "numba.np.arrayobj", "numba.np.linalg"),  # at the first step
    ]
)


@dataclass(frozen=True)
class Surroundings:
    """What a job finds around itself.

    Attributes:
        file_limit: bytes that a file may have (`ulimit -f`); None for no limit.
        namespaces: files of /proc that stand for the user and mount namespaces to enter, see `small_disk`.
        environment: variables on top of the tests' own.
    """

    file_limit: int | None = None
    namespaces: Sequence[Path] = ()
    environment: Mapping[str, str] | None = None


ORDINARY = Surroundings()


@dataclass(frozen=True)
class Ended:
    """How a job ended: its exit code, negative for a signal, and all that it said."""

    code: int
    said: str

    @property
    def complaint(self) -> str:
        """The one line that tells the user what is wrong; fails the test if there is none, several or a traceback."""
        assert self.code == 2, self
        assert "Traceback" not in self.said, self.said
        (line,) = (line for line in self.said.splitlines() if line.startswith("error: "))
        return line


def ensure_server() -> None:
    """Start the server in the environment as it is now: its children inherit it."""
    first = SERVER.Process(target=str, daemon=True)
    first.start()
    first.join(PATIENCE_S)


class Running:
    """A job that was started."""

    def __init__(self, arguments: Sequence[str], log: Path, around: Surroundings = ORDINARY) -> None:
        self._log = log
        self._process = SERVER.Process(target=_rauca, args=(list(arguments), str(log), around), daemon=True)
        self._process.start()

    @property
    def pid(self) -> int:
        assert self._process.pid is not None
        return self._process.pid

    @property
    def alive(self) -> bool:
        return self._process.is_alive()

    def until(self, reached: Callable[[], bool]) -> Running:
        """Wait until the job has got somewhere; fails the test if it ends before."""
        deadline = time.monotonic() + PATIENCE_S
        while not reached():
            assert self.alive, self.wait()
            assert time.monotonic() < deadline, self._log.read_text()
            time.sleep(0.002)
        return self

    def signal(self, number: int) -> None:
        os.kill(self.pid, number)

    def wait(self) -> Ended:
        self._process.join(PATIENCE_S)
        assert self._process.exitcode is not None, self._log.read_text()
        return Ended(self._process.exitcode, self._log.read_text())


def rauca(arguments: Sequence[str], log: Path, around: Surroundings = ORDINARY) -> Ended:
    """Run a job to its end."""
    return Running(arguments, log, around).wait()


def _rauca(arguments: Sequence[str], log: str, around: Surroundings) -> None:
    """In the job's own process."""
    with open(log, "wb") as stream:
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)
    os.environ.update(around.environment or {})
    os.environ["COLUMNS"] = "400"  # nothing that is said is broken into lines
    libc = ctypes.CDLL(None, use_errno=True)
    for place in around.namespaces:
        handle = os.open(place, os.O_RDONLY)
        kind = CLONE_NEWUSER if place.name == "user" else CLONE_NEWNS
        if libc.setns(handle, kind):
            raise OSError(ctypes.get_errno(), f"cannot enter {place}")
        os.close(handle)
    if around.file_limit is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (around.file_limit, around.file_limit))
    sys.argv = ["rauca", *arguments]
    from pipelines.cli import run

    run()
