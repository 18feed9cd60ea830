"""A job in stages: each is done once, timed, and skipped when the job runs again with the same arguments."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rauca_core.contract import RaucaError
from rauca_core.contract.files import write_json
from rauca_core.contract.schema import read_json


class Stages:
    """The stages of a job that writes to one folder, remembered in ``stages.json``.

    A stage interrupted halfway is entered again: the work inside must resume by itself. Seconds add up over entries.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / "stages.json"
        self._done: dict[str, dict[str, Any]] = {}
        if self._path.is_file():
            try:
                found = read_json(self._path)
                self._done = {name: found.nested(name).without("") for name in found.without("")}
            except RaucaError:
                self._path.unlink()  # only a memory of work that can be checked again

    def run(self, name: str, arguments: Any, work: Callable[[], object], product: Path) -> None:
        """Do ``work`` unless ``product`` exists and was made by this stage with the same ``arguments`` (JSON)."""
        arguments = json.loads(json.dumps(arguments))  # as the file gives them back: a tuple is a list there
        entry = self._done.get(name, {})
        same = entry.get("arguments") == arguments
        if same and entry.get("finished") and product.exists():
            return
        spent = entry.get("seconds", 0.0) if same and not entry.get("finished") else 0.0
        started = time.perf_counter()
        finished = False
        try:
            work()
            finished = True
        finally:
            seconds = round(spent + time.perf_counter() - started, 2)
            self._done[name] = {"arguments": arguments, "seconds": seconds, "finished": finished}
            write_json(self._path, self._done)

    def seconds(self) -> dict[str, float]:
        """Seconds that each finished stage took."""
        return {name: entry["seconds"] for name, entry in self._done.items() if entry.get("finished")}
