"""Rendering a dataset, as a job beside the window: the same command as the headless pipeline's."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..core import contract
from .job import Told
from .thumbnail import thumbnail


@dataclass(frozen=True)
class DatasetTask:
    """Renders what ``folder`` lacks.

    Attributes:
        folder: of the dataset.
        start: the command.
        scratch: a folder that only the job needs; removed at its end.
    """

    folder: Path
    start: Sequence[str]
    scratch: Path

    def command(self) -> list[str]:
        return list(self.start)

    def hear(self, line: str) -> Told | None:
        if line.startswith("note: "):
            return Told(note=line.removeprefix("note: "))
        try:
            progress = contract.parse_progress(line)
        except (ValueError, TypeError):  # a line that the child's end cut off
            return None
        if progress is None:
            return None
        picture = thumbnail(self.folder / "frames" / progress.last / "image.png") if progress.last else None
        pictures = {} if picture is None else {"frame": picture}
        return Told(progress.done, progress.total, progress.left_s, pictures=pictures)

    def clean(self) -> None:
        shutil.rmtree(self.scratch, ignore_errors=True)
