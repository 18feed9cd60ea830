"""Seconds that the stages of a job took, over all of its interrupted and resumed runs."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path

from rauca_core.contract import RaucaError
from rauca_core.contract.files import write_json
from rauca_core.contract.schema import read_json


class Clock:
    """Adds up seconds by stage in a JSON file; what was found finished adds nothing worth telling."""

    def __init__(self, path: Path) -> None:
        self._path = path

    @property
    def seconds(self) -> dict[str, float]:
        """Stage -> seconds so far."""
        with contextlib.suppress(RaucaError):
            kept = read_json(self._path)
            return {name: kept.number(name) for name in kept.names()}
        return {}

    @contextlib.contextmanager
    def time(self, stage: str) -> Iterator[None]:
        """Count what happens inside, however it ends."""
        started = time.perf_counter()
        try:
            yield
        finally:
            seconds = self.seconds
            seconds[stage] = round(seconds.get(stage, 0.0) + time.perf_counter() - started, 2)
            write_json(self._path, seconds)
