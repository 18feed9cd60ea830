"""A supervisor and its workers: what they say to each other, one marked JSON line each way, and what each side does.

A worker is a Blender of its own. It gets pieces of work, lists of frames, on its standard input.
"""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from queue import SimpleQueue

from ..core import child_process, contract, reading, system

_MARK = "rauca-worker "
STOP = "stop"


@dataclass(frozen=True)
class News:
    """What a worker tells, on its standard output.

    Attributes:
        event: ``ready`` (the scene is built), ``begin`` (a frame is in flight from here on), ``done``, ``occluded``,
            ``failed`` (Python raised; the worker goes on), ``idle`` (the piece of work is finished), ``note`` (of the
            scene, for the user).
        frame: which one; empty for ``ready``, ``idle`` and ``note``.
        seconds: that a done frame took.
        visible: share of the paint that an occluded frame would show.
        reason: why a frame failed, or what is noted.
    """

    event: str
    frame: str = ""
    seconds: float = 0.0
    visible: float = 0.0
    reason: str = ""

    def line(self) -> str:
        """The line to print."""
        return _MARK + json.dumps(asdict(self))


def parse_news(line: str) -> News | None:
    """The news in a line, None for anything else that Blender prints; raises :class:`RaucaError` for a damaged one."""
    if not line.startswith(_MARK):
        return None
    try:
        return News(**reading.parse_json(line.removeprefix(_MARK), "news"))
    except (contract.RaucaError, TypeError) as error:
        raise contract.RaucaError(f"Blender said {line.strip()[:80]!r}, which is no news of a worker") from error


def tell(news: News) -> None:
    """Tell the supervisor."""
    print(news.line(), flush=True)


def serve(
    render: Callable[[Sequence[str], Callable[[News], None], Callable[[], bool]], None], orders: Iterable[bytes]
) -> None:
    """A worker's side: render piece after piece; returns when told to stop, at the next frame boundary.

    When ``orders`` closes, the supervisor is gone: the process ends at once, in the middle of a frame if need be, so
    that it neither wastes the machine nor meets its successor. Frames are written atomically; nothing is harmed.

    Args:
        render: renders frames by id, tells what happens, and asks before each frame whether to stop.
        orders: one JSON line each: a list of frame ids, or ``"stop"``.
    """
    pieces: SimpleQueue[list[str] | None] = SimpleQueue()
    stopping = threading.Event()

    def listen() -> None:
        for line in orders:
            order = json.loads(line)
            if order == STOP:
                stopping.set()
                pieces.put(None)
            else:
                pieces.put(order)
        os._exit(1)

    threading.Thread(target=listen, daemon=True).start()
    tell(News("ready"))
    while (piece := pieces.get()) is not None and not stopping.is_set():
        render(piece, tell, stopping.is_set)
        tell(News("idle"))


class Worker:
    """The supervisor's side of a worker: the process, what it was given, what it says, how it ends.

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
        """Hand over a piece of work; of one that is dead the end arrives in the inbox."""
        self.piece = list(piece)
        self._process.order(json.dumps(piece))

    def settle(self, frame: str) -> None:
        """Note that a frame is done with."""
        self.piece.remove(frame)
        self.in_flight = None
        self.rendered += 1

    def dismiss(self) -> None:
        """Let it end at the next frame boundary."""
        self._process.order(json.dumps(STOP))

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
        if name := system.killed_by(code):
            return f"Blender was killed by {name}" + (" (out of memory?)" if name == "SIGKILL" else "")
        return f"Blender stopped with code {code}: {next(reversed(self._process.complaints()), 'no message')}"

    def _hear(self, line: str) -> None:
        try:
            if not self._garbled and (news := parse_news(line)):
                self._inbox.put((self, news))
        except contract.RaucaError as error:  # whatever it says from here on, something is lost: replace it
            self._garbled = str(error)
            self.kill()
