"""Stopping: Ctrl-C and SIGTERM are one, and end the step in progress, then the run."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType
from typing import NoReturn

from ..contract.system import stop_signals


class StopRequest:
    """Whether someone asked the run to stop, and how."""

    def __init__(self) -> None:
        self.signal: signal.Signals | None = None

    def __bool__(self) -> bool:
        return self.signal is not None


@contextlib.contextmanager
def stop_request() -> Iterator[StopRequest]:
    """Listen for SIGINT and SIGTERM; a second Ctrl-C raises KeyboardInterrupt at once.

    Signals reach the main thread only: elsewhere this listens to nothing.
    """
    request = StopRequest()
    if threading.current_thread() is not threading.main_thread():
        yield request
        return

    def note(number: int, _: FrameType | None) -> None:
        if request and number == signal.SIGINT:
            raise KeyboardInterrupt
        request.signal = signal.Signals(number)

    previous = {number: signal.signal(number, note) for number in stop_signals()}
    try:
        yield request
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def take_sigterm_for_ctrl_c() -> None:
    """From now on SIGTERM raises KeyboardInterrupt: what a job has started is stopped, what is finished is kept."""

    def interrupt(number: int, stack: FrameType | None) -> NoReturn:
        raise KeyboardInterrupt

    for number in set(stop_signals()) - {signal.SIGINT}:
        signal.signal(number, interrupt)
