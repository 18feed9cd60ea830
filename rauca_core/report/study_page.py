"""A study as one HTML file that can be mailed, archived and opened anywhere; its numbers and main figures as files."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ParamSpec

from ..contract import RaucaError
from ..contract.files import write_bytes
from ..study import evaluate as evaluation
from ..study import study as measured
from ..study.defences import NO_DEFENCE
from ..study.detectors import family_of, in_table_order
from ..study.parts import ATTACKED, leading
from ..study.study import Entry
from .before_after import before_after
from .figures import curve_svg, history_svg, paint_styles
from .frames import FramePicker, strongest_paint
from .page import write_study_page
from .pictures import maps_of, sheet_of
from .published import paper_tables
from .study_tables import (
    averaged_over,
    counted,
    curves_of,
    defence_title,
    tables_of,
    unique,
    vehicles_of,
    weathers_title,
)
from .table import is_normal, is_random, printed

P = ParamSpec("P")
MAX_PICTURES = 100  # keeps the page's size in hand, about 15 kB each
HERO = "before-after.jpg"


@dataclass(frozen=True)
class ReportNotes:
    """What the numbers alone do not say.

    Attributes:
        title: of the page.
        histories: camouflage -> term -> one value per optimization step.
        settings: name -> value, as the reader should see them.
        commands: more commands behind the page's numbers than the study's own.
        timings_s: stage -> seconds.
        limitations: sentences added to the general ones.
    """

    title: str = "Camouflage evaluation"
    histories: Mapping[str, Mapping[str, Sequence[float]]] = field(default_factory=dict)
    settings: Mapping[str, object] = field(default_factory=dict)
    commands: Sequence[str] = ()
    timings_s: Mapping[str, float] = field(default_factory=dict)
    limitations: Sequence[str] = ()


def write_report(study: measured.Study, out: Path, notes: ReportNotes | None = None, latex: bool = False) -> list[Path]:
    """Write the report of a study to ``out`` (.html) and its numbers beside it (.csv, .json; .tex if asked for).

    The page is self-contained: no script, nothing loaded. It links to the results' files, relative to its folder.

    Returns:
        What was written, the page first.

    Raises:
        RaucaError: images, detections or camouflages that are missing or do not belong to the results; then nothing
            was written.
    """
    notes, tables, curves = notes or ReportNotes(), tables_of(study), curves_of(study)
    papers = {paper.beside: paper for paper in paper_tables()}
    last_of_kind = {table.key.partition("-")[0]: table.key for table in tables}
    told = {
        "title": notes.title,
        "scope": scope(study),
        "lead": headline(study),
        "styles": paint_styles(dict.fromkeys(paint for entry in study.entries for paint in entry.results.paints)),
        "tables": tables,
        "places": study.entries[0].results.place_kind,
        "columns": [column for table in tables for column in table.columns],
        "papers": {key: papers[kind] for kind, key in last_of_kind.items() if kind in papers},
        "curves": {weathers_title(weathers): some for weathers, some in curves.items() if some},
        "sets": len(curves),
        "averaged": averaged_over(study.entries[0]),
        "maps": maps_of(study.entries),
        "history": history_svg(notes.histories) if notes.histories else "",
        **_pictures(study),
    }
    every = [*tables, *(curve for some in curves.values() for curve in some)]
    behind = notes.settings, notes.commands, notes.timings_s, notes.limitations
    return write_study_page(study, out, "study.html", told, every, {}, *behind, latex)


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


def scope(study: measured.Study) -> str:
    """How much was measured."""
    results = [entry.results for entry in study.entries]
    detectors = unique(name for found in results for name in found.detectors)
    paints = unique(paint for found in results for paint in found.paints)
    conditions = unique(weathers_title(entry.weathers).removesuffix(" weathers").lower() for entry in study.entries)
    defences = [defence_title(d) for d in unique(entry.defence for entry in study.entries) if d != NO_DEFENCE]
    parts = [
        counted(len(paints), "paint"),
        counted(len(detectors), "detector"),
        counted(len(vehicles_of(study)), "vehicle"),
        " and ".join(conditions) + (" weathers" if {"seen", "unseen"} >= set(conditions) else ""),
        *([f"defences: {', '.join(defences)}"] if defences else []),
    ]
    images = sum(len(found.frames) * len(found.paints) for found in results)
    return f"{', '.join(parts)}; {images:,} images evaluated."


def headline(study: measured.Study) -> list[str]:
    """A sentence per set of weathers: how far the most effective paint lowers AP, undefended."""
    entries = study.of(vehicle=vehicles_of(study)[0], defence=NO_DEFENCE)
    return [_sentence(entry) for entry in entries if any(map(is_normal, entry.results.paints))]


def _sentence(entry: Entry) -> str:
    results, (_, detectors) = entry.results, leading(entry.parts)
    where, of = f"{weathers_title(entry.weathers).capitalize()}: ", averaged_over(entry)
    normal = next(paint for paint in results.paints if is_normal(paint))
    # Random paint alone lowers AP too: no result should be read without it.
    best = strongest_paint(entry)
    told = dict.fromkeys((normal, *filter(is_random, results.paints), best))
    means = {paint: entry.recorded.mean_over(detectors, paint) for paint in told}
    before, after = means[normal], means[best]
    values = ", ".join(f"{printed(mean.ap)} for {paint}" for paint, mean in means.items())
    if best == normal:
        return f"{where}{entry.category} AP@0.5, {of}: {values}."
    verb = "lowers" if after.ap < before.ap else "does not lower"
    randoms = [paint for paint in means if is_random(paint) and paint != best]
    cautions = [f", no lower than {paint}" for paint in randoms if after.ap >= means[paint].ap]
    if after.high >= before.low and before.high >= after.low:
        cautions.append(f"; the intervals of {normal} and {best} overlap")
    return f"{where}{best} {verb} {entry.category} AP@0.5, {of}: {values}{''.join(cautions)}."


def _pictures(study: measured.Study) -> dict[str, Any]:
    """Grids of the first vehicle's frames for the detectors that were attacked, then one of every other family."""
    entries = study.of(vehicle=vehicles_of(study)[0], defence=NO_DEFENCE)
    if not entries:
        return {"grids": {}}
    picker, asked = FramePicker(entries), _shown_detectors(entries)
    most = max(1, MAX_PICTURES // picker.pictures)
    return {"picker": picker, "grids": {name: picker.grid(name) for name in asked[:most]}, "left_out": asked[most:]}


def _shown_detectors(entries: Sequence[Entry]) -> list[str]:
    """Those that were attacked, then the first of every other family."""
    names = in_table_order(list(entries[0].results.detectors))
    attacked = [name for name in names if any(name in entry.parts.get(ATTACKED, ()) for entry in entries)]
    families = {family_of(name) for name in attacked}
    others = [next(n for n in names if family_of(n) == f) for f in unique(map(family_of, names)) if f not in families]
    return [*attacked, *others]


def save_showcase(study: measured.Study, folder: Path) -> list[Path]:
    """Write the main figures as files, for a README or a talk.

    ``grid.jpg``, ``before-after.jpg`` where the vehicle was seen in its own paint, ``table.md``, a ``map-<name>.jpg``
    each and, per parameter varied, ``ap-<parameter>.svg``: all of the first vehicle, undefended, under the study's
    first weathers.

    Raises:
        RaucaError: that vehicle was evaluated behind defences only.
    """
    vehicle = vehicles_of(study)[0]
    entry = next(iter(study.of(vehicle=vehicle, defence=NO_DEFENCE)), None)
    if entry is None:
        raise RaucaError(f"{folder}: no pictures; the {vehicle} was evaluated with defences only, add the defence none")
    folder.mkdir(parents=True, exist_ok=True)
    detector = _shown_detectors([entry])[0]
    seen = FramePicker([entry]).grid(detector).rows
    tiles = {paint: [picture.jpeg for picture in row if picture] for paint, row in seen.items()}
    sheet_of(tiles).save(folder / "grid.jpg", quality=88)
    hero = before_after(entry, detector)
    if hero is not None:
        hero.save(folder / HERO, quality=90, subsampling=0, optimize=True)
    files = {"table.md": _markdown(entry).encode()}
    files |= {f"map-{camouflage.name}.jpg": jpeg for camouflage, jpeg in maps_of([entry])}
    styles = paint_styles(entry.results.paints)
    curves = {curve.key.partition("-")[0]: curve for curve in curves_of(study)[entry.weathers]}
    around = f"{averaged_over(entry)}, 95 % intervals"
    files |= {f"ap-{name}.svg": curve_svg(curve, styles, legend=around).encode() for name, curve in curves.items()}
    for name, data in files.items():
        write_bytes(folder / name, data)
    return [folder / name for name in ("grid.jpg", *([HERO] if hero else []), *files)]


def _markdown(entry: Entry) -> str:
    """AP@0.5 of every paint and detector with its 95 % interval."""
    table = entry.results.table
    columns = list(next(iter(table.values())))
    lines = ["| paint | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for paint, row in table.items():
        cells = (f"{row[name].ap:.3f} ({row[name].low:.2f}-{row[name].high:.2f})" for name in columns)
        lines.append(f"| {paint} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"
