"""A worker's side: take pieces of work from standard input until it closes."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable, Iterable, Sequence
from queue import SimpleQueue

from .messages import News

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
