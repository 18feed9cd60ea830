"""A reader under test: a valid folder, the file in it that is damaged, and how it is read."""

from __future__ import annotations

import contextlib
import json
import resource
import signal
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from rauca_core.contract import RaucaError

from .mutate import Damage, mutate_bytes

CPU_SECONDS = 20  # of one damaged file: the slowest healthy one takes under a second
MEMORY = 2**30  # that one damaged file may add; the limits of the readers keep tiny files far below


@dataclass(frozen=True)
class Target:
    """One reader.

    Attributes:
        file: what is damaged, relative to the folder.
        build: writes the valid folder; a text is all that the file holds.
        read: reads it; may raise :class:`RaucaError`, nothing else.
        damage: that suits the format.
        writes: the reader's contract is to mend the file in place.
        signs: the card beside the file is made to name it before it is read.
    """

    name: str
    file: str
    build: Callable[[Path], object] | str
    read: Callable[[Path], object]
    damage: Damage = mutate_bytes
    writes: bool = False
    signs: bool = False

    def seed(self, folder: Path) -> bytes:
        """Build the valid folder; returns the healthy bytes of the file."""
        path = folder / self.file
        path.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(self.build, str):
            path.write_text(self.build)
        else:
            self.build(folder)
        return path.read_bytes()

    def try_on(self, folder: Path, data: bytes) -> RaucaError | None:
        """Read ``data`` in place of the healthy file; the complaint, or None when it was read."""
        (folder / self.file).write_bytes(data)
        return self.complaint(folder)

    def complaint(self, folder: Path) -> RaucaError | None:
        """What the reader says of a folder, in bounded memory and time; None when it was read."""
        try:
            with bounded():
                self.read(folder)
        except RaucaError as complaint:
            return complaint
        return None


def json_lines(*rows: object) -> str:
    return "".join(json.dumps(row) + "\n" for row in rows)


class TooLongError(BaseException):
    """A file took more CPU time than any healthy one could."""


@contextlib.contextmanager
def bounded(memory: int = MEMORY, cpu_seconds: int = CPU_SECONDS) -> Iterator[None]:
    """Let what runs inside neither hang nor take more than ``memory`` bytes; exceeding either is an exception."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (_address_space() + memory, hard))
    previous = signal.signal(signal.SIGVTALRM, _too_long)
    signal.setitimer(signal.ITIMER_VIRTUAL, cpu_seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, previous)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def _address_space() -> int:
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def _too_long(number: int, frame: FrameType | None) -> None:
    raise TooLongError(f"more than {CPU_SECONDS} s of CPU time")
