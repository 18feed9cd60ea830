"""Timing by turns, so that a busy moment of the machine hits all contenders alike; and progress by count."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from pipelines.console import progress_bar
from rauca_core.contract import Progress


class Clock:
    """Laps in milliseconds: of wall time, or of this process's CPU time."""

    def __init__(self, now: Callable[[], float] = time.perf_counter) -> None:
        self.laps: list[float] = []
        self._now = now
        self.restart()

    def restart(self) -> None:
        """What was done since the last lap does not count."""
        self._started = self._now()

    def lap(self) -> None:
        """One more lap, since the last one or the restart."""
        self.laps.append(1e3 * (self._now() - self._started))
        self._started = self._now()


def race(
    contenders: Mapping[str, Callable[[Clock], object]],
    rounds: int,
    now: Callable[[], float] = time.perf_counter,
    warm_up: int = 1,
    moved: Callable[[], None] = lambda: None,
) -> dict[str, NDArray[np.float64]]:
    """Laps (rounds, laps) in milliseconds of each contender, which take turns.

    Args:
        contenders: each takes its laps on the clock that it is given; one that takes none is timed as a whole.
        now: ``time.perf_counter``, or ``time.process_time`` for CPU time.
        warm_up: rounds before, which compile and fill caches and are not counted.
        moved: called after each contender's turn.
    """
    laps: dict[str, list[list[float]]] = {name: [] for name in contenders}
    for number in range(-warm_up, rounds):
        for name, work in contenders.items():
            clock = Clock(now)
            work(clock)
            if not clock.laps:
                clock.lap()
            if number >= 0:
                laps[name].append(clock.laps)
            moved()
    return {name: np.array(rows) for name, rows in laps.items()}


@contextmanager
def counted(title: str, total: int) -> Iterator[Callable[..., None]]:
    """A progress bar; yields a function to call after each of ``total`` steps, with the step's name if it has one."""
    with progress_bar(title, resumes=False) as move:
        done = 0

        def moved(last: str = "") -> None:
            nonlocal done
            done += 1
            move(Progress(min(done, total), total, last))

        yield moved
