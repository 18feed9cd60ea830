"""What a supervisor and its workers say to each other: one marked JSON line each way."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

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
    """The news in a line, or None for anything else that Blender prints."""
    return News(**json.loads(line.removeprefix(_MARK))) if line.startswith(_MARK) else None
