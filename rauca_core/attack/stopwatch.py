"""Where the seconds of a step go."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator

STAGES = ("load", "taps", "environment", "augmentation", "detector", "backward", "adam")


class Stopwatch:
    """Seconds by stage; what is in no stage is in none."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(STAGES, 0.0)

    @contextlib.contextmanager
    def time(self, stage: str) -> Iterator[None]:
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] += time.perf_counter() - begin
