"""A supervisor's side of a worker: the process, what it was given, what it says, how it ends."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import threading
from collections import deque
from collections.abc import Sequence
from queue import SimpleQueue

from ..core import contract
from .worker import STOP, News, parse_news

TAIL_LINES = 40


class Worker:
    """A running worker process.

    Attributes:
        piece: frames it was given and has not settled, in order.
        in_flight: the frame it began last and has not settled; None between frames.
        rendered: frames it has settled in its life.
    """

    def __init__(self, command: Sequence[str], inbox: SimpleQueue[tuple[Worker, News | None]]) -> None:
        """Start it; its news arrive in ``inbox`` with itself, None when it has ended."""
        self.piece: list[str] = []
        self.in_flight: str | None = None
        self.rendered = 0
        self._garbled = ""
        self._complaints: deque[str] = deque(maxlen=TAIL_LINES)
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,  # Ctrl-C reaches the supervisor alone, which lets the frame in flight finish
        )
        self._complaining = threading.Thread(target=self._collect_complaints, daemon=True)
        self._complaining.start()
        threading.Thread(target=self._pass_on, args=(inbox,), daemon=True).start()

    @property
    def pid(self) -> int:
        return self._process.pid

    def give(self, piece: list[str]) -> None:
        """Hand over a piece of work."""
        self.piece = list(piece)
        self._order(piece)

    def settle(self, frame: str) -> None:
        """Note that a frame is done with."""
        self.piece.remove(frame)
        self.in_flight = None
        self.rendered += 1

    def dismiss(self) -> None:
        """Let it end at the next frame boundary."""
        self._order(STOP)

    def kill(self) -> None:
        """End it at once."""
        self._process.kill()

    def mistake(self) -> str | None:
        """The sentence of a worker that ended because of something only the user can mend."""
        if self._process.wait() != 2:
            return None
        marked = (line for line in reversed(self._complaints) if line.startswith("error: "))
        return next((line.removeprefix("error: ") for line in marked), None)

    def death(self) -> str:
        """How a worker ended that should not have: the signal, or its last words."""
        code = self._process.wait()
        if self._garbled:
            return self._garbled
        if code < 0:
            name = signal.Signals(-code).name
            return f"Blender was killed by {name}" + (" (out of memory?)" if name == "SIGKILL" else "")
        return f"Blender stopped with code {code}: {next(reversed(self._complaints), 'no message')}"

    def _order(self, order: object) -> None:
        stdin = self._process.stdin
        assert stdin is not None
        try:
            stdin.write(json.dumps(order) + "\n")
            stdin.flush()
        except (BrokenPipeError, ValueError):
            pass  # it is dead; its end arrives in the inbox

    def _pass_on(self, inbox: SimpleQueue[tuple[Worker, News | None]]) -> None:
        try:
            for line in self._process.stdout or ():
                if news := parse_news(line):
                    inbox.put((self, news))
        except contract.RaucaError as error:  # whatever it says from here on, something is lost: replace it
            self._garbled = str(error)
            self.kill()
        self._complaining.join(timeout=5)
        self._process.wait()
        inbox.put((self, None))

    def _collect_complaints(self) -> None:
        for line in self._process.stderr or ():
            if line.strip():
                self._complaints.append(line.strip())


def own_threads(workers: int) -> int:
    """Threads for each of several workers, so that together they fill the machine."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, cores // workers)
