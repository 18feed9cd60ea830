"""What a piece of work cost, also where it was stopped and went on."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from ..contract.files import write_json
from ..contract.schema import read_json

FILE = "cpu.json"


@contextlib.contextmanager
def counted_in(folder: Path, fresh: bool = False) -> Iterator[Callable[[], float]]:
    """CPU minutes of this process, with those of the runs before it that were stopped within.

    They are kept in the folder however the work within ends. A kill that leaves no time to write loses its own run's.

    Args:
        fresh: the work begins anew; what earlier ones took does not count.

    Yields:
        What tells the minutes so far.
    """
    path, began = folder / FILE, time.process_time()
    before = read_json(path).number("cpu_minutes", 0.0) if path.is_file() and not fresh else 0.0

    def minutes() -> float:
        return before + (time.process_time() - began) / 60

    try:
        yield minutes
    finally:
        write_json(path, {"cpu_minutes": minutes()})
