"""A child process whose lines are heard by threads, so that nobody waits for it. No torch: the extension carries it."""

from __future__ import annotations

import contextlib
import subprocess
import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import IO

from ..contract import system

KEPT_COMPLAINTS = 200  # lines
LONGEST_LINE = 65536  # characters: a child that never ends its line must not fill the memory
PATIENCE_S = 30.0


class ChildProcess:
    """A running command, in a session of its own: Ctrl-C reaches its parent alone."""

    def __init__(self, command: Sequence[str]) -> None:
        """Start it; raises :class:`OSError` when the program cannot be started."""
        self._complaints: deque[str] = deque(maxlen=KEPT_COMPLAINTS)
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            **system.own_session(),
        )
        self._readers = [threading.Thread(target=self._read, args=(self._process.stderr, self._keep), daemon=True)]
        self._readers[0].start()

    @property
    def pid(self) -> int:
        return self._process.pid

    def listen(self, hear: Callable[[str], object], ended: Callable[[], object] = lambda: None) -> None:
        """Hear what it says on standard output, in a thread of its own.

        Args:
            hear: is given each line.
            ended: is called once the process has ended and everything that it said was heard.
        """

        def listen() -> None:
            self._read(self._process.stdout, hear)
            self._readers[0].join(timeout=5)
            self._process.wait()
            ended()

        self._readers.append(threading.Thread(target=listen, daemon=True))
        self._readers[-1].start()

    def order(self, line: str) -> None:
        """Say something to it, on its standard input; one that has ended does not mind."""
        stdin = self._process.stdin
        assert stdin is not None
        with contextlib.suppress(BrokenPipeError, ValueError):
            stdin.write(line + "\n")
            stdin.flush()

    def code(self) -> int | None:
        """The exit code once it has ended and everything it said was heard, negative for a signal; None before."""
        code = self._process.poll()
        return None if code is None or any(reader.is_alive() for reader in self._readers) else code

    def wait(self) -> int:
        """Wait for its end; returns the exit code."""
        return self._process.wait()

    def complaints(self) -> list[str]:
        """The last lines on standard error, oldest first."""
        return list(self._complaints)

    def stop(self) -> None:
        """Ask it to end at the next good moment."""
        system.ask_to_end(self._process)

    def kill(self) -> None:
        """End it at once."""
        with contextlib.suppress(OSError):
            self._process.kill()

    def end(self) -> None:
        """Ask it and what it has started to end, wait, and end them if that takes too long."""
        system.end_all(self._process, PATIENCE_S)

    def _keep(self, line: str) -> None:
        if line.strip():
            self._complaints.append(line.strip())

    @staticmethod
    def _read(stream: IO[str] | None, hear: Callable[[str], object]) -> None:
        if stream is not None:
            for line in iter(lambda: stream.readline(LONGEST_LINE), ""):
                hear(line.rstrip("\n"))
