"""What a supervisor and its workers say to each other: one marked JSON line each way."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

from ..core import contract, reading

_MARK = "rauca-worker "


@dataclass(frozen=True)
class News:
    """What a worker tells, on its standard output.

    Attributes:
        event: ``ready`` (the scene is built), ``begin`` (a frame is in flight from here on), ``done``, ``occluded``,
            ``failed`` (Python raised; the worker goes on), ``idle`` (the piece of work is finished), ``note`` (of the
            scene, for the user).
        frame: which one; empty for ``ready``, ``idle`` and ``note``.
        seconds: that a done frame took.
        visible: share of the paint that an occluded frame would show.
        reason: why a frame failed, or what is noted.
    """

    event: str
    frame: str = ""
    seconds: float = 0.0
    visible: float = 0.0
    reason: str = ""

    def line(self) -> str:
        """The line to print."""
        return _MARK + json.dumps(asdict(self))


def parse_news(line: str) -> News | None:
    """The news in a line, or None for anything else that Blender prints.

    Raises:
        RaucaError: the line is damaged.
    """
    if not line.startswith(_MARK):
        return None
    try:
        return News(**reading.parse_json(line.removeprefix(_MARK), "news"))
    except (contract.RaucaError, TypeError) as error:
        raise contract.RaucaError(f"Blender said {line.strip()[:80]!r}, which is no news of a worker") from error
