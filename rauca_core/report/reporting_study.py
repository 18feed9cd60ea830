"""A study that writes its own page: what the public face hands out. `study` measures and knows of no page."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ParamSpec

from ..contract import RaucaError
from ..study import evaluate as evaluation
from ..study import study as measured
from .study_page import ReportNotes, write_report

P = ParamSpec("P")


@dataclass(frozen=True)
class Study(measured.Study):
    """What was evaluated: ``entries`` hold the results of a vehicle, set of weathers and defence each.

    ``table()`` gives all of it as one table, ``report()`` as a page.
    """

    @classmethod
    def load(cls, folder: Path | str) -> Study:
        """Read a study's folder; raises :class:`RaucaError` where there is none, or what it names is damaged."""
        if not (Path(folder) / measured.FILE_NAME).is_file():
            raise RaucaError(f"{folder}: has no {measured.FILE_NAME}; run `rauca evaluate` or `rauca demo` first")
        return cls._of(measured.load_study(Path(folder)))

    def report(self, path: Path | str = "report.html", latex: bool = False) -> Path:
        """Write the study as one self-contained page, and its numbers beside it as CSV and JSON (LaTeX if asked for).

        Returns:
            The page's path.

        Raises:
            RaucaError: images, detections or camouflages that are missing or do not belong to the results.
        """
        return write_report(self, Path(path), ReportNotes(**self.notes), latex)[0]

    @classmethod
    def _of(cls, study: measured.Study) -> Study:
        return cls(study.command, study.entries, study.notes)


def _reporting(make: Callable[P, measured.Study]) -> Callable[P, Study]:
    @functools.wraps(make)
    def made(*args: P.args, **kwargs: P.kwargs) -> Study:
        return Study._of(make(*args, **kwargs))

    return made


evaluate = _reporting(evaluation.evaluate)
