"""How a process tells another how far it is, a JSON object a line."""

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


@dataclass(frozen=True)
class OptimizeProgress:
    """One line on standard output.

    Attributes:
        step: steps done, ``of`` so many; a resumed run goes on counting where it stopped.
        of: steps in all.
        loss: Eq. 8; ``attack`` and ``smooth`` are its terms without their weights.
        score: max H_d, mean over the batch: how well the detectors still see the vehicle, in [0, 1].
        seconds: that the step took.
        left_s: estimate of the seconds left.
        preview: path of a PNG that shows the UV map and a frame in the paint, side by side; replaced as the run goes.
        uv_map: path of a PNG of the UV map alone, at most 512 texels a side; replaced likewise.
    """

    step: int
    of: int
    loss: float
    attack: float
    smooth: float
    score: float
    seconds: float
    left_s: float
    preview: str
    uv_map: str

    def line(self) -> str:
        """The line to print."""
        return json.dumps(asdict(self), allow_nan=False)


def parse_optimize_progress(line: str) -> OptimizeProgress | None:
    """The progress that a line tells, or None for any other line; fields of later versions are left out."""
    try:
        told = parse_json(line, "progress")
        return OptimizeProgress(**{name: told[name] for name in OptimizeProgress.__dataclass_fields__})
    except (RaucaError, KeyError, TypeError):
        return None


def format_duration(seconds: float) -> str:
    """A duration for people: ``45 s``, ``12 min``, ``3 h 20 min``."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
