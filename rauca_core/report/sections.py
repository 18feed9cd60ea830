"""What pages of every kind of study share: their files, where their numbers come from, what they do not say."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..contract.files import write_bytes
from ..study.families import family_of, in_table_order, is_own
from ..study.study import Entry, Study
from .page import Aside, Bullets, Commands, Facts, Figure, Figures, Heading, Note, Page, Part, Picture, Section
from .pictures import maps_of
from .published import PaperTable, odd_averages
from .study_tables import defence_title, results_file, unique, vehicles_of, weathers_title, white_box_of
from .table import Cell, Column, Row, Table, listing
from .writers import tables_csv, tables_json, tables_latex

MAX_MAPS = 8


def write_study_page(
    study: Study,
    out: Path,
    page: Page,
    tables: Sequence[Table],
    about: Mapping[str, Any],
    settings: Mapping[str, object],
    commands: Sequence[str] = (),
    timings_s: Mapping[str, float] | None = None,
    limits: Sequence[str] = (),
    latex: bool = True,
) -> list[Path]:
    """Write a page to ``out`` (.html) and the numbers of some tables beside it (.csv, .json, .tex).

    Args:
        page: without the sections that all pages end with.
        about: more fields of the JSON.
        settings: name -> value, as the reader should see them.
        commands: behind the page's numbers, beside the study's own.
        timings_s: stage -> seconds.
        limits: sentences added to what no page says.

    Returns:
        What was written, the page first.
    """
    files = {".csv": tables_csv(tables), ".json": tables_json(tables, study.command, about)}
    if latex:
        files[".tex"] = tables_latex(tables, study.command)
    base, beside = out.parent, [out.with_suffix(suffix).name for suffix in files]
    closing = [provenance(study, base, beside, settings, commands, timings_s), limitations(study, limits)]
    whole = replace(page, sections=[*page.sections, *closing], anchors=anchors_of(study, base))
    written = {".html": whole.html().encode(), **files}
    for suffix, data in written.items():
        write_bytes(out.with_suffix(suffix), data)
    return [out.with_suffix(suffix) for suffix in written]


def limitations(study: Study, more: Sequence[str]) -> Section:
    general = [
        "Rendered frames are not photographs: what holds here need not hold for a real vehicle, camera and paint.",
        "The intervals say how much the numbers would move with other draws of what the bootstrap draws; other towns, "
        "other vehicles and other optimization runs are not part of them.",
        "Every image holds one target; a detection of its class anywhere else counts as a false positive.",
    ]
    fewest = min(len(entry.results.frames) for entry in study.entries)
    if fewest < 100:
        general.append(f"{fewest} frames are few: read small differences with care.")
    return Section("Limitations", [Bullets([*general, *more])])


def published_aside(paper: PaperTable) -> Aside:
    """The paper's table, marked off from ours."""
    notes = [
        "As printed, not measured here: another simulator, vehicle and places, and other detectors, so compare the "
        "order and the size of effects rather than digits."
    ]
    if any(column.name == "DDTR" for column in paper.table.columns):
        notes.append("Its groups are kept: it counts DDTR, a transformer, among the single-stage detectors.")
    if odd := odd_averages(paper.table):
        notes.append(f"Printed averages that are not the mean of their row: {'; '.join(odd)}.")
    return Aside(f"{paper.table.title}: published figures", " ".join(notes), paper.table)


def maps(entries: Sequence[Entry]) -> list[Section]:
    """The UV maps of all camouflages, each once."""
    drawn, every = [], maps_of(entries)
    for camouflage, jpeg in every[:MAX_MAPS]:
        caption = f"{camouflage.name} for the {camouflage.vehicle_name}: {camouflage.size} × {camouflage.size} texels"
        drawn.append(Figure(Picture(jpeg, f"UV map {caption}"), caption))
    note = "sRGB UV maps over the vehicle's atlas; outlined: paint that may change; faded: never seen on the vehicle."
    if len(every) > MAX_MAPS:
        note += f" The first {MAX_MAPS} of {len(every)}."
    return [Section("UV maps", [Figures("maps", drawn)], note)] if drawn else []


def anchors_of(study: Study, base: Path) -> dict[str, str]:
    """File of results, relative to ``base`` -> id of its row on the page."""
    return {results_file(entry, base): f"data-{number}" for number, entry in enumerate(study.entries, start=1)}


def provenance(
    study: Study,
    base: Path,
    beside: Sequence[str],
    settings: Mapping[str, object],
    commands: Sequence[str],
    timings_s: Mapping[str, float] | None,
) -> Section:
    """Where every number comes from: commands, files, detectors, settings."""
    first = study.entries[0].results
    counted = {
        "lowest score counted": first.settings.score_threshold,
        "overlap of non-maximum suppression": first.settings.iou_threshold,
        "bootstrap": f"{first.resamples} resamples of {first.clusters}, seed {first.seed}, 95 % interval",
    }
    parts: list[Part] = [
        Heading("Command"),
        Commands(unique([study.command, *commands])),
        Heading("Results"),
        _results(study, base),
        Note("All numbers of this page, at full precision:", beside),
        Heading("Detectors"),
        _detectors(study),
        Heading("Settings"),
        Facts({**counted, **settings}),
    ]
    if timings_s:
        parts += [Heading("Time taken"), Facts({stage: f"{seconds:.1f} s" for stage, seconds in timings_s.items()})]
    note = "Each number above links to its row below; hover over it for the place inside the file."
    return Section("Where the numbers come from", parts, note)


def _results(study: Study, base: Path) -> Table:
    several = len(vehicles_of(study)) > 1
    names = ["vehicle"] * several + ["defence", "frames", "left out", "bootstrap draws", "file"]
    anchors = anchors_of(study, base)
    rows = []
    for entry in study.entries:
        results, file = entry.results, results_file(entry, base)
        told = [*([entry.vehicle] if several else []), defence_title(entry.defence)]
        told += [str(len(results.frames)), str(len(results.dropped)), f"{results.cluster_count} {results.clusters}"]
        digest = hashlib.sha256((entry.folder / "results.json").read_bytes()).hexdigest()
        cells = (*map(Cell, told), Cell(file, link=file), Cell(digest[:16]))
        rows.append(Row(weathers_title(entry.weathers), cells, anchors[file]))
    columns = (*(Column(name, kind="text") for name in names), Column("sha256", kind="code"))
    return listing("results", "weathers", columns, tuple(rows))


def _detectors(study: Study) -> Table:
    prints = {name: value for entry in study.entries for name, value in entry.results.detectors.items()}
    against: dict[str, list[str]] = {}
    for entry in study.entries:
        for paint, names in white_box_of(entry).items():
            for name in names:
                against.setdefault(name, []).append(paint)
    rows = []
    for name in in_table_order(list(prints)):
        trained = "this project's synthetic images" if is_own(name) else "its publisher's images"
        met = ", ".join(unique(against.get(name, []))) or "–"
        rows.append(Row(name, tuple(map(Cell, (family_of(name), trained, met, prints[name][:16])))))
    columns = [Column(name, kind="text") for name in ("family", "trained on", "white-box for")]
    return listing("fingerprints", "detector", (*columns, Column("fingerprint", kind="code")), tuple(rows))
