"""Optimizing a camouflage, as a job beside the window: ``rauca optimize`` in a Python of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core import contract, schema
from ..jobs.background import JobUpdate
from ..jobs.thumbnails import thumbnail

CHECKPOINT = Path("checkpoints") / "checkpoint.json"
HISTORY = "history.jsonl"
FIGURES = ("loss", "score")
MAX_HISTORY_BYTES = 2**28  # as `rauca optimize` reads it


@dataclass
class OptimizeTask:
    """Optimizes a camouflage into ``folder``, going on where an earlier run stopped.

    Attributes:
        folder: of the camouflage, its history and its checkpoints.
        start: the command, without what makes it go on.
    """

    folder: Path
    start: Sequence[str]
    _told_history: bool = False
    _seen: dict[str, int] = field(default_factory=dict)

    def command(self) -> list[str]:
        return [*self.start, "--resume"] if begun(self.folder) else list(self.start)

    def hear(self, line: str) -> JobUpdate | None:
        progress = contract.parse_optimize_progress(line)
        if progress is None:
            return None
        figures: list[Mapping[str, float]] = [] if self._told_history else earlier(self.folder, progress.step)
        self._told_history = True
        figures.append({name: getattr(progress, name) for name in FIGURES})
        pictures = self._renewed(Path(progress.preview))
        return JobUpdate(progress.step, progress.of, progress.left_s, figures=figures, pictures=pictures)

    def clean(self) -> None:
        pass

    def _renewed(self, preview: Path) -> dict[str, NDArray[np.uint8]]:
        """The pictures, if their file was replaced since they were last read: the UV map and a painted frame."""
        try:
            changed = preview.stat().st_mtime_ns
        except OSError:
            return {}
        if self._seen.get("preview") == changed or (both := thumbnail(preview)) is None:
            return {}
        self._seen["preview"] = changed
        half = both.shape[1] // 2
        return {"uv_map": both[:, :half], "painted": both[:, half:]}


def begun(folder: Path) -> bool:
    """Whether ``folder`` holds a run that can go on."""
    return (folder / CHECKPOINT).is_file()


def earlier(folder: Path, step: int) -> list[Mapping[str, float]]:
    """The figures of the steps before ``step``, as an earlier run left them."""
    try:
        told = schema.whole_lines(folder / HISTORY, MAX_HISTORY_BYTES, "a history of steps", _figures)
    except contract.RaucaError:
        return []
    return [figures for at, figures in told if at < step]


def _figures(line: schema.Fields) -> tuple[int, Mapping[str, float]]:
    return line.integer("step"), {name: line.number(name) for name in FIGURES}
