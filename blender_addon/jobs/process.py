"""A child process whose lines are read by threads, so that nobody waits for it."""

from __future__ import annotations

import contextlib
import subprocess
import threading
from collections import deque
from collections.abc import Callable, Sequence
from queue import Empty, SimpleQueue
from typing import IO

KEPT_COMPLAINTS = 40
LONGEST_LINE = 65536  # characters: a child that never ends its line must not fill the memory


class BackgroundProcess:
    """A running command. Its output goes through ``hear`` in a thread; what that returns waits to be fetched."""

    def __init__(self, command: Sequence[str], hear: Callable[[str], object | None]) -> None:
        """Start it.

        Args:
            hear: makes something of a line of standard output, or None of one that matters to nobody. Runs in a thread
                of its own: no Blender in there.

        Raises:
            OSError: the program cannot be started.
        """
        self._news: SimpleQueue[object] = SimpleQueue()
        self._complaints: deque[str] = deque(maxlen=KEPT_COMPLAINTS)
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,  # Ctrl-C in Blender's terminal is Blender's
        )
        self._readers = [
            threading.Thread(target=self._listen, args=(self._process.stdout, hear), daemon=True),
            threading.Thread(target=self._collect, args=(self._process.stderr,), daemon=True),
        ]
        for reader in self._readers:
            reader.start()

    @property
    def pid(self) -> int:
        return self._process.pid

    def news(self, most: int) -> list[object]:
        """What was heard since the last call, oldest first, ``most`` at a time; waits for nothing."""
        found: list[object] = []
        with contextlib.suppress(Empty):
            while len(found) < most:
                found.append(self._news.get_nowait())
        return found

    def code(self) -> int | None:
        """The exit code once it has ended and everything it said was heard, negative for a signal; None before."""
        code = self._process.poll()
        return None if code is None or any(reader.is_alive() for reader in self._readers) else code

    def complaints(self) -> list[str]:
        """The last lines on standard error."""
        return list(self._complaints)

    def stop(self) -> None:
        """Ask it to end at the next good moment."""
        with contextlib.suppress(OSError):
            self._process.terminate()

    def kill(self) -> None:
        """End it at once."""
        with contextlib.suppress(OSError):
            self._process.kill()

    def _listen(self, stream: IO[str], hear: Callable[[str], object | None]) -> None:
        for line in iter(lambda: stream.readline(LONGEST_LINE), ""):
            if (found := hear(line.rstrip("\n"))) is not None:
                self._news.put(found)

    def _collect(self, stream: IO[str]) -> None:
        for line in iter(lambda: stream.readline(LONGEST_LINE), ""):
            if line.strip():
                self._complaints.append(line.strip())
