"""A study: evaluations of the same camouflages under several sets of weathers and defences, on one or more vehicles.

``study.json`` names the results of each; everything it refers to lies beside it::

    {"format": "rauca-study", "version": 2, "command": "rauca evaluate ...", "entries": [
      {"weathers": "seen", "defence": "none", "vehicle": "sedan", "category": "car",
       "results": "sedan/seen/none/results.json", "views": "sedan/seen/views",
       "camouflages": {"rauca": "camouflages/<content>/rauca.json"},
       "parts": {"took no part": ["mobilenet-ssd"], "attacked": ["yolov3-tiny"]}}, ...]}

``parts`` is for programs that average over detectors (`parts.py`); it follows from the camouflages and the results.
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any

from ..contract import RaucaError, load_camouflage
from ..contract.files import write_json
from ..contract.schema import Record, read_json
from .parts import parts_of
from .recorded import Recorded
from .results import Results, load_results

FILE_NAME = "study.json"


@dataclass(frozen=True)
class Entry:
    """One evaluation of a study: a set of views and weathers, seen through a defence.

    Attributes:
        weathers: ``"seen"``, ``"unseen"``, or the name of whichever data set was evaluated on.
        defence: as `make_defence` takes it; ``"none"`` for none.
        vehicle, category: whose camouflages these are, and the class that detectors are asked for.
        results: what was found.
        folder: holds ``results.json``; its image paths start there.
        views: the data set of held-out views; None when the study does not say.
        camouflages: paint -> camouflage JSON, of every paint but the vehicle's own (``"normal"``).
    """

    weathers: str
    defence: str
    vehicle: str
    category: str
    results: Results
    folder: Path
    views: Path | None = None
    camouflages: dict[str, Path] = field(default_factory=dict)

    @cached_property
    def recorded(self) -> Recorded:
        """What was detected."""
        return Recorded(self.results, self.folder)

    @cached_property
    def against(self) -> dict[str, tuple[str, ...]]:
        """Paint -> the detectors it was optimized against, for paints that were.

        Raises:
            RaucaError: a camouflage that the study names is missing or damaged.
        """
        made = {paint: load_camouflage(path)[0].made.get("detector") for paint, path in self.camouflages.items()}
        return {paint: tuple(names.split("+")) for paint, names in made.items() if isinstance(names, str)}

    @property
    def parts(self) -> dict[str, list[str]]:
        """The detectors by their part in the attacks, see `parts.py`; raises :class:`RaucaError` as :attr:`against`."""
        return parts_of(list(self.results.detectors), set(chain(*self.against.values())))


@dataclass(frozen=True)
class Study:
    """What was evaluated.

    Attributes:
        command: what was typed, to repeat or resume the study.
        entries: in the order they were asked for.
        notes: what a report should tell beside the numbers: fields of ``ReportNotes``.
    """

    command: str
    entries: tuple[Entry, ...]
    notes: Mapping[str, Any] = field(default_factory=dict)

    def table(self) -> Any:
        """A row per vehicle, weathers, defence, paint and detector.

        Returns:
            A `pandas.DataFrame` where pandas is installed, else a list of dicts with the same names: ``vehicle``,
            ``weathers``, ``defence``, ``paint``, ``detector``, ``part`` (what the detector had to do with the attacks:
            average within one part alone), ``ap`` (AP@0.5, 0 to 1), ``low`` and ``high`` (its 95 % interval) and ``n``
            (frames).

        Raises:
            RaucaError: a camouflage that the study names is missing or damaged.
        """
        rows = [
            {
                "vehicle": entry.vehicle, "weathers": entry.weathers, "defence": entry.defence, "paint": paint,
                "detector": detector, "part": part, "ap": row[detector].ap, "low": row[detector].low,
                "high": row[detector].high, "n": len(entry.results.frames),
            }
            for entry in self.entries
            for paint, row in entry.results.table.items()
            for part, detectors in entry.parts.items()
            for detector in detectors
        ]  # fmt: skip
        return data_frame(rows)

    def of(self, **wanted: str) -> tuple[Entry, ...]:
        """Entries whose fields have the wanted values: ``study.of(defence="none", vehicle="sedan")``."""
        return tuple(e for e in self.entries if all(getattr(e, name) == value for name, value in wanted.items()))


def data_frame(rows: list[dict[str, Any]]) -> Any:
    """The rows as a `pandas.DataFrame` where pandas is installed, else as they are."""
    if importlib.util.find_spec("pandas") is None:
        return rows
    import pandas

    return pandas.DataFrame(rows)


@dataclass(frozen=True, eq=False)
class _Row(Record):
    """An entry on disk; paths are relative to the file."""

    weathers: str
    defence: str
    vehicle: str
    category: str
    results: str
    views: str | None = None
    camouflages: dict[str, str] = field(default_factory=dict)
    parts: dict[str, tuple[str, ...]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _File(Record):
    """``study.json``."""

    FORMAT = ("rauca-study", 2)
    REMEDY = Results.REMEDY

    command: str
    entries: tuple[_Row, ...]
    notes: dict[str, Any] = field(default_factory=dict)

    def _check_whole(self, where: str) -> None:
        keys = {(row.vehicle, row.weathers, row.defence) for row in self.entries}
        if not self.entries or len(keys) != len(self.entries):
            raise RaucaError(f"{where}: entries must be at least one, each of its own vehicle, weathers and defence")


def save_study(path: Path, command: str, entries: Sequence[Entry], notes: Mapping[str, Any] | None = None) -> None:
    """Write ``study.json`` atomically; the results that it names were written before."""

    def relative(target: Path) -> str:
        return Path(os.path.relpath(target, Path(path).parent)).as_posix()

    rows = [
        _Row(
            *(entry.weathers, entry.defence, entry.vehicle, entry.category),
            results=relative(entry.folder / "results.json"),
            views=None if entry.views is None else relative(entry.views),
            camouflages={paint: relative(camouflage) for paint, camouflage in entry.camouflages.items()},
            parts={part: tuple(names) for part, names in entry.parts.items()},
        )
        for entry in entries
    ]
    write_json(path, _File(command, tuple(rows), dict(notes or {})).to_json())


def load_study(path: Path) -> Study:
    """Read ``study.json`` (the file or its folder) with all its results.

    Raises:
        RaucaError: it, or results that it names, are missing, damaged or from a newer rauca; two entries are the same.
    """
    path = Path(path) / FILE_NAME if Path(path).is_dir() else Path(path)
    base, file = path.parent, _File.from_json(read_json(path))
    entries = [
        Entry(
            *(row.weathers, row.defence, row.vehicle, row.category),
            results=load_results(base / row.results),
            folder=(base / row.results).parent,
            views=None if row.views is None else base / row.views,
            camouflages={paint: base / camouflage for paint, camouflage in row.camouflages.items()},
        )
        for row in file.entries
    ]
    return Study(file.command, tuple(entries), file.notes)
