"""How a job in a process of its own tells how far it is: one marked JSON line on standard output."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

from .errors import RaucaError
from .reading import parse_json

_MARK = "rauca-progress "


@dataclass(frozen=True)
class Progress:
    """``done`` of ``total`` items; ``last`` names the newest, ``left_s`` estimates the seconds left, if known."""

    done: int
    total: int
    last: str
    left_s: float | None = None

    def line(self) -> str:
        """The line to print."""
        return _MARK + json.dumps(asdict(self))


def parse_progress(line: str) -> Progress | None:
    """The progress a line tells, or None for any other line."""
    if not line.startswith(_MARK):
        return None
    try:
        return Progress(**parse_json(line.removeprefix(_MARK), "progress"))
    except (RaucaError, TypeError):  # two processes wrote at once, or it is none of ours
        return None
