"""What a supervisor and its workers say to each other: one marked JSON line each way."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from queue import SimpleQueue

from ..core import contract, reading

_MARK = "rauca-worker "


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
    """The news in a line, or None for anything else that Blender prints.

    Raises:
        RaucaError: the line is damaged.
    """
    if not line.startswith(_MARK):
        return None
    try:
        return News(**reading.parse_json(line.removeprefix(_MARK), "news"))
    except (contract.RaucaError, TypeError) as error:
        raise contract.RaucaError(f"Blender said {line.strip()[:80]!r}, which is no news of a worker") from error


STOP = "stop"


def serve(
    render: Callable[[Sequence[str], Callable[[News], None], Callable[[], bool]], None], orders: Iterable[bytes]
) -> None:
    """Render piece after piece; returns when told to stop, at the next frame boundary.

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


def tell(news: News) -> None:
    """Tell the supervisor."""
    print(news.line(), flush=True)
