"""The timer that watches jobs, run by hand: without a window Blender runs none."""

from __future__ import annotations

import time
from collections.abc import Callable


def until(reached: Callable[[], bool], seconds: float = 900.0) -> float:
    """Let the timer's function run until ``reached``; returns the longest it took of this thread's own time."""
    from blender_addon.jobs import watch

    deadline, longest = time.monotonic() + seconds, 0.0
    while not reached():
        assert time.monotonic() < deadline
        begin = time.thread_time()
        watch.tick()
        longest = max(longest, time.thread_time() - begin)
        time.sleep(0.02)
    return longest
