"""A study as one HTML file that can be mailed, archived and opened anywhere; its numbers as CSV and JSON beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from .. import __version__
from ..contract.files import write_bytes
from ..study.study import Study
from . import pages, sections
from .colors import paint_styles
from .data_section import anchors_of, data_section
from .headline import headline, scope
from .tables import curves_of, tables_csv, tables_json, tables_latex, tables_of
from .tables.html import TableWriter


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


def write_report(study: Study, out: Path, notes: ReportNotes | None = None, latex: bool = False) -> list[Path]:
    """Write the report of a study to ``out`` (.html) and its numbers beside it (.csv, .json; .tex if asked for).

    The page is self-contained: no script, nothing loaded. It links to the results' files, relative to its folder.

    Returns:
        What was written, the page first.

    Raises:
        RaucaError: images, detections or camouflages that are missing or do not belong to the results; then nothing
            was written.
    """
    notes = notes or ReportNotes()
    base = out.parent
    tables, curves = tables_of(study, base), curves_of(study, base)
    styles = paint_styles(dict.fromkeys(paint for entry in study.entries for paint in entry.results.paints))
    write = TableWriter(styles, anchors_of(study, base))
    every = [*tables, *(curve for some in curves.values() for curve in some)]
    files = {".csv": tables_csv(every), ".json": tables_json(every, study.command)}
    if latex:
        files[".tex"] = tables_latex(tables, study.command)
    body = [
        *sections.tables(tables, study, write),
        *sections.pictures(study),
        *sections.curves(curves, styles, write),
        *sections.maps(study),
        *sections.training(notes.histories),
        data_section(study, base, notes, [out.with_suffix(suffix).name for suffix in files]),
        sections.limitations(study, notes.limitations),
    ]
    header = f"<h1>{escape(notes.title)}</h1><p>{escape(scope(study))}</p>" + "".join(
        pages.paragraph(sentence, "lead") for sentence in headline(study)
    )
    footer = f"Written by rauca {escape(__version__)}. Every table, picture and curve is inside this file."
    written = {".html": pages.page(notes.title, header, body, footer).encode(), **files}
    for suffix, data in written.items():
        write_bytes(out.with_suffix(suffix), data)
    return [out.with_suffix(suffix) for suffix in written]
