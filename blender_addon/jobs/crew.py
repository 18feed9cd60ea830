"""A supervisor's side of a worker: the process, what it was given, what it says, how it ends."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Sequence
from queue import SimpleQueue

from ..core import child_process, contract
from .worker import STOP, News, parse_news


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
        self._inbox = inbox
        self._process = child_process.ChildProcess(command)
        self._process.listen(self._hear, lambda: inbox.put((self, None)))

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
        marked = (line for line in reversed(self._process.complaints()) if line.startswith("error: "))
        return next((line.removeprefix("error: ") for line in marked), None)

    def death(self) -> str:
        """How a worker ended that should not have: the signal, or its last words."""
        code = self._process.wait()
        if self._garbled:
            return self._garbled
        if code < 0:
            name = signal.Signals(-code).name
            return f"Blender was killed by {name}" + (" (out of memory?)" if name == "SIGKILL" else "")
        return f"Blender stopped with code {code}: {next(reversed(self._process.complaints()), 'no message')}"

    def _order(self, order: object) -> None:
        self._process.order(json.dumps(order))  # of one that is dead the end arrives in the inbox

    def _hear(self, line: str) -> None:
        try:
            if not self._garbled and (news := parse_news(line)):
                self._inbox.put((self, news))
        except contract.RaucaError as error:  # whatever it says from here on, something is lost: replace it
            self._garbled = str(error)
            self.kill()


def own_threads(workers: int) -> int:
    """Threads for each of several workers, so that together they fill the machine."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, cores // workers)
