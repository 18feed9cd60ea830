"""The timer that watches jobs, run by hand: without a window Blender runs none."""

from __future__ import annotations

import time
from collections.abc import Callable

from blender_addon.jobs import watch


def until(reached: Callable[[], bool], seconds: float = 900.0, tick: Callable[[], object] | None = None) -> float:
    """Let the timer's function, or ``tick``, run until ``reached``; returns the longest it took on this thread."""
    tick = tick or watch.tick
    deadline, longest = time.monotonic() + seconds, 0.0
    while not reached():
        assert time.monotonic() < deadline
        begin = time.thread_time()
        tick()
        longest = max(longest, time.thread_time() - begin)
        time.sleep(0.02)
    return longest
