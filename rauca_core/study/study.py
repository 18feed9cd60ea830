"""A study: evaluations of the same camouflages under several sets of weathers and defences, on one or more vehicles.

``study.json`` names the results of each; everything it refers to lies beside it::

    {"format": "rauca-study", "version": 1, "command": "rauca evaluate ...", "entries": [
      {"weathers": "seen", "defence": "none", "vehicle": "sedan", "category": "car",
       "results": "sedan/seen/none/results.json", "views": "sedan/seen/views",
       "camouflages": {"rauca": "camouflages/<content>/rauca.json"}}, ...]}
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..contract import RaucaError
from ..contract.files import write_json
from ..contract.schema import Fields, read_json
from .results import Results, load_results

FORMAT = ("rauca-study", 1)
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

    @property
    def key(self) -> tuple[str, str, str]:
        """What no two entries of a study share."""
        return self.vehicle, self.weathers, self.defence


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
        """A row per vehicle, weathers, defence, paint and detector, with ``"mean"`` as the last detector of each paint.

        Returns:
            A `pandas.DataFrame` where pandas is installed, else a list of dicts with the same names: ``vehicle``,
            ``weathers``, ``defence``, ``paint``, ``detector``, ``ap`` (AP@0.5, 0 to 1), ``low`` and ``high`` (its 95 %
            interval) and ``n`` (frames).
        """
        rows = [
            {
                "vehicle": entry.vehicle, "weathers": entry.weathers, "defence": entry.defence, "paint": paint,
                "detector": detector, "ap": found.ap, "low": found.low, "high": found.high,
                "n": len(entry.results.frames),
            }
            for entry in self.entries
            for paint, row in entry.results.table.items()
            for detector, found in row.items()
        ]  # fmt: skip
        if importlib.util.find_spec("pandas") is None:
            return rows
        import pandas

        return pandas.DataFrame(rows)

    def of(self, **wanted: str) -> tuple[Entry, ...]:
        """Entries whose fields have the wanted values: ``study.of(defence="none", vehicle="sedan")``."""
        return tuple(e for e in self.entries if all(getattr(e, name) == value for name, value in wanted.items()))


def save_study(path: Path, command: str, entries: Sequence[Entry], notes: Mapping[str, Any] | None = None) -> None:
    """Write ``study.json`` atomically; the results that it names were written before."""
    name, version = FORMAT
    path = Path(path)
    rows = [_row(entry, path.parent) for entry in entries]
    opening = {"format": name, "version": version, "command": command, "entries": rows}
    write_json(path, {**opening, "notes": notes} if notes else opening)


def load_study(path: Path) -> Study:
    """Read ``study.json`` (the file or its folder) with all its results.

    Raises:
        RaucaError: it, or results that it names, are missing, damaged or from a newer rauca; two entries are the same.
    """
    path = Path(path) / FILE_NAME if Path(path).is_dir() else Path(path)
    fields = read_json(path)
    fields.format(*FORMAT)
    rows = [Fields(row, f"{path}: entries[{i}]") for i, row in enumerate(fields.items("entries"))]
    notes = fields.nested("notes").without("") if fields.has("notes") else {}
    study = Study(fields.text("command"), tuple(_entry(row, path.parent) for row in rows), notes)
    fields.done()
    if not study.entries or len({entry.key for entry in study.entries}) != len(study.entries):
        raise RaucaError(f"{path}: entries must be at least one, each of its own vehicle, weathers and defence")
    return study


def _row(entry: Entry, base: Path) -> dict[str, Any]:
    views = {} if entry.views is None else {"views": _relative(entry.views, base)}
    return {
        "weathers": entry.weathers,
        "defence": entry.defence,
        "vehicle": entry.vehicle,
        "category": entry.category,
        "results": _relative(entry.folder / "results.json", base),
        **views,
        "camouflages": {paint: _relative(path, base) for paint, path in entry.camouflages.items()},
    }


def _entry(fields: Fields, base: Path) -> Entry:
    results = base / fields.text("results")
    named = fields.raw("camouflages") if fields.has("camouflages") else {}
    camouflages = Fields(named, f"{fields.where}: camouflages")
    entry = Entry(
        weathers=fields.text("weathers"),
        defence=fields.text("defence"),
        vehicle=fields.text("vehicle"),
        category=fields.text("category"),
        results=load_results(results),
        folder=results.parent,
        views=base / fields.text("views") if fields.has("views") else None,
        camouflages={paint: base / camouflages.text(paint) for paint in named},
    )
    fields.done()
    return entry


def _relative(path: Path, base: Path) -> str:
    return Path(os.path.relpath(path, base)).as_posix()
