"""What every benchmark shares: its extent, timing by turns, what it found, its page in docs/.

``rauca bench NAME`` calls a module's ``bench(out, settings, docs, ...)``, with its ``FULL`` or ``QUICK`` settings. That
fills :class:`Results` and writes them to ``out`` (JSON) and, where ``docs`` is a folder, to a page and pictures.
"""

from __future__ import annotations

import json
import math
import os
import platform
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic_core import to_json
from rich.table import Table as Printed

from pipelines.console import output, progress_bar
from rauca_core.contract import Progress, RaucaError
from rauca_core.contract.files import write_bytes, write_json

Row = dict[str, Any]
END = "<!-- end of figures -->"


class Settings(SimpleNamespace):
    """How much is measured, by name: everything, a quick look, or what a test takes."""

    def but(self, **changed: Any) -> Settings:
        """The same with some values changed; raises TypeError where there is no such setting."""
        if unknown := changed.keys() - vars(self).keys():
            raise TypeError(f"no such settings: {', '.join(sorted(unknown))}")
        return Settings(**{**vars(self), **changed})


@dataclass(frozen=True)
class Target:
    """What was hoped for: ``found`` passes if it is at least, or with ``most`` at most, ``wanted``."""

    what: str
    wanted: float
    found: float
    unit: str = ""
    most: bool = False

    @property
    def passed(self) -> bool:
        return self.found <= self.wanted if self.most else self.found >= self.wanted


class Table(NamedTuple):
    """A table as it is shown; ``on_page`` if the page in docs/ has it too."""

    title: str
    headers: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    on_page: bool = True


@dataclass
class Results:
    """What one run of a benchmark found, filled part by part. Names of values end in their units."""

    benchmark: str
    settings: Settings
    rows: dict[str, list[Row]] = field(default_factory=dict)  # by kind
    figures: dict[str, Any] = field(default_factory=dict)  # what else goes to the JSON
    tables: list[Table] = field(default_factory=list)
    targets: list[Target] = field(default_factory=list)  # never asserted: times depend on the machine
    pictures: list[tuple[Callable[[Path], None], str, str]] = field(default_factory=list)

    def add(self, kind: str, /, **values: Any) -> Row:
        """One more row of a kind."""
        self.rows.setdefault(kind, []).append(values)
        return values

    def where(self, kind: str, /, **wanted: Any) -> list[Row]:
        """The rows of a kind that have these values."""
        return [row for row in self.rows.get(kind, []) if all(row[name] == value for name, value in wanted.items())]

    def one(self, kind: str, /, **wanted: Any) -> Row:
        """The first of those rows."""
        return self.where(kind, **wanted)[0]

    def distinct(self, kind: str, name: str) -> list[Any]:
        """The values of that name, each once, in the order of the rows."""
        return list(dict.fromkeys(row[name] for row in self.rows.get(kind, [])))

    def table(self, title: str, columns: Mapping[str, str], rows: Iterable[Row], on_page: bool = True) -> None:
        """Add a table; ``columns``: headers and formats of a row's values, ``{"forward, ms": "{forward_ms:.2f}"}``."""
        cells = [tuple(form.format(**row) for form in columns.values()) for row in rows]
        self.tables.append(Table(title, tuple(columns), cells, on_page))

    def target(self, what: str, wanted: float, found: float, unit: str = "", most: bool = False) -> None:
        self.targets.append(Target(what, wanted, found, unit, most))

    def target_table(self, title: str = "Targets") -> None:
        """Add all targets so far as a table."""
        rows = [
            (
                target.what,
                f"{'≤' if target.most else '≥'} {target.wanted:g} {target.unit}".strip(),
                f"{target.found:.4g}",
                "pass" if target.passed else "FAIL",
            )
            for target in self.targets
        ]
        self.tables.append(Table(title, ("what", "wanted", "found", ""), rows))

    def picture(self, save: Callable[[Path], None], ending: str, name: str) -> None:
        """Add a picture: what saves it, the ending of its name beside the JSON, its name below ``docs/pictures``."""
        self.pictures.append((save, ending, name))

    def to_json(self) -> dict[str, Any]:
        """All of it; infinity and NaN become null, as JSON has neither."""
        whole = {
            "format": f"rauca-bench-{self.benchmark}",
            "version": 2,
            "machine": {"cpus": os.cpu_count(), "processor": platform.machine()},
            "settings": vars(self.settings),
            **self.figures,
            **self.rows,
            "targets": [{**vars(target), "passed": target.passed} for target in self.targets],
        }
        plain: dict[str, Any] = json.loads(to_json(whole, inf_nan_mode="null"))
        return plain

    def publish(self, out: Path, docs: Path | None = None, page: str = "", width: int = 120) -> None:
        """Print every table, ``width`` characters wide in a log; write JSON and pictures, renew ``docs/page``."""
        console = output(width)
        for table in self.tables:
            printed = Printed(*table.headers, title=table.title)
            for row in table.rows:
                printed.add_row(*row)
            console.print(printed)
        write_json(out, self.to_json())
        if docs is not None:
            fill_page(docs / page, "\n".join(_markdown(t) for t in self.tables if t.on_page), self.benchmark)
        for save, ending, name in self.pictures:
            for path in [out.with_name(out.stem + ending), *([docs / "pictures" / name] if docs else [])]:
                path.parent.mkdir(parents=True, exist_ok=True)
                save(path)


def _markdown(table: Table) -> str:
    lines = [f"### {table.title}", "", "| " + " | ".join(table.headers) + " |", "|---" * len(table.headers) + "|"]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in table.rows)]) + "\n"


def mark(benchmark: str) -> str:
    """What stands on a page before the figures of a ``rauca bench`` command."""
    return f"<!-- figures: written by rauca bench {benchmark} --docs -->"


def fill_page(page: Path, figures: str, benchmark: str) -> None:
    """Renew a page's figures; one that does not exist is made of them alone."""
    if not page.is_file():
        write_bytes(page, f"{mark(benchmark)}\n{END}\n".encode())
    fill_between(page, mark(benchmark), END, figures)


def fill_between(page: Path, begin: str, end: str, text: str) -> None:
    """Replace what stands between two marks of a page; raises :class:`RaucaError` where they are gone."""
    before, begins, rest = page.read_text().partition(begin)
    _, ends, after = rest.partition(end)
    if not begins or not ends:
        raise RaucaError(f"{page}: the marks for what is written here are gone; put {begin} and {end} back")
    write_bytes(page, f"{before}{begin}\n\n{text}\n{end}{after}".encode())


def psnr_db(squared_errors: ArrayLike, most_db: float = math.inf) -> float:
    """Peak signal to noise ratio of values in [0, 1] by their squared errors, ``most_db`` at most; NaN of none."""
    errors = np.asarray(squared_errors, np.float64)
    mean = float(errors.mean()) if errors.size else math.nan
    return most_db if mean <= 0 else min(-10 * math.log10(mean), most_db)


class Clock:
    """Laps in milliseconds: of wall time, or of this process's CPU time."""

    def __init__(self, now: Callable[[], float] = time.perf_counter) -> None:
        self.laps: list[float] = []
        self._now = now
        self.restart()

    def restart(self) -> None:
        self._started = self._now()

    def lap(self) -> None:
        self.laps.append(1e3 * (self._now() - self._started))
        self._started = self._now()


def race(
    contenders: Mapping[str, Callable[[Clock], object]], rounds: int, moved: Callable[[], None] = lambda: None
) -> dict[str, NDArray[np.float64]]:
    """Laps (rounds, laps) in milliseconds of each contender; they take turns: a busy moment hits all alike.

    A contender that takes no laps on its clock is timed as a whole. One more round, the first, is not counted.
    """
    laps: dict[str, list[list[float]]] = {name: [] for name in contenders}
    for number in range(-1, rounds):
        for name, work in contenders.items():
            clock = Clock()
            work(clock)
            if not clock.laps:
                clock.lap()
            if number >= 0:
                laps[name].append(clock.laps)
            moved()
    return {name: np.array(rows) for name, rows in laps.items()}


@contextmanager
def counted(title: str, total: int) -> Iterator[Callable[..., None]]:
    """A progress bar; yields a function to call after each of ``total`` steps."""
    with progress_bar(title, resumes=False) as move:
        done = 0

        def moved(last: str = "") -> None:
            nonlocal done
            done += 1
            move(Progress(min(done, total), total, last))

        yield moved
