"""An ablation as one HTML file, and its numbers as CSV and JSON beside it."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from html import escape
from pathlib import Path
from typing import Any

from .. import __version__
from ..contract.files import write_bytes
from ..study.ablations.findings import Findings
from ..study.ablations.paired import Scores
from ..study.ablations.verdicts import Outcome, Verdict
from ..study.results import Estimate
from . import pages, sections
from .ablation_tables import FILE, beside_table, gap_table, main_table, paper_table
from .colors import paint_styles
from .data_section import anchors_of
from .grid import FramePicker
from .maps import maps_of
from .tables import tables_csv
from .tables.html import TableWriter
from .tables.model import AVERAGE

FORMAT = ("rauca-ablation", 1)
_MARKS: dict[Outcome, str] = {"confirmed": "✓", "refuted": "✗", "undecided": "?"}


def write_ablation(found: Findings, out: Path) -> list[Path]:
    """Write ``out`` (.html) and its numbers (.json, .csv) beside it.

    Returns:
        What was written, the page first.

    Raises:
        RaucaError: images, detections or camouflages of the study are missing; then nothing was written.
    """
    scores = found.scores()
    verdicts, table, paper = found.verdicts(scores), main_table(found, scores), paper_table(found)
    beside = beside_table(found, scores, paper) if paper else None
    anchors = {FILE: "data", **anchors_of(found.study, out.parent)}
    write = TableWriter(paint_styles(found.titles.values()), anchors)
    body = [
        _verdicts(found, verdicts),
        pages.section(table.title, write(table), _reading(found)),
        *(
            [pages.section(beside.title, write(beside) + sections.published_aside(paper, write))]
            if paper and beside
            else []
        ),
        _pictures(found),
        _settings(found),
        _data(found, out),
        sections.limitations(found.study, _limits(found)),
    ]
    lead = "".join(pages.paragraph(line, "lead") for line in _headline(verdicts))
    header = f"<h1>{escape(found.experiment.title)}</h1><p>{escape(found.experiment.question)}</p>{lead}"
    footer = f"Written by rauca {escape(__version__)}. Every table and picture is inside this file."
    files = {
        ".html": pages.page(found.experiment.title, header, body, footer).encode(),
        ".json": _json(found, scores, verdicts),
        ".csv": tables_csv([table, *([beside] if beside else [])]),
    }
    for suffix, data in files.items():
        write_bytes(out.with_suffix(suffix), data)
    return [out.with_suffix(suffix) for suffix in files]


def _headline(verdicts: Sequence[Verdict]) -> list[str]:
    counts = Counter(verdict.outcome for verdict in verdicts if verdict.claim.by == "the paper")
    if not counts:
        return []
    told = ", ".join(f"{counts[outcome]} {outcome}" for outcome in _MARKS if counts[outcome])
    return [f"Of the paper's orderings: {told}."]


def _verdicts(found: Findings, verdicts: Sequence[Verdict]) -> str:
    lines = [f"{_MARKS[verdict.outcome]} {verdict.sentence(found.titles)}" for verdict in verdicts]
    head, *rows = gap_table(found, verdicts)
    seeds = max(len(paints) for paints in found.paints.values())
    note = (
        "A gap is AP@0.5 of one camouflage minus that of another on the same frames; its 95 % interval is a bootstrap "
        f"over {found.study.entries[0].results.clusters}, both in the same places"
        + (" and over optimizations" if seeds > 1 else "")
        + ". Confirmed: the interval lies above 0; refuted: below; undecided: it holds 0."
        + ("" if seeds > 1 else " One optimization each: the luck of a seed is not in the intervals.")
    )
    return pages.section("Orderings", pages.bullets(lines) + _listing(head, rows), note)


def _reading(found: Findings) -> str:
    first = found.study.entries[0].results
    return (
        "AP@0.5 from 0 to 1; the lower, the better the camouflage. Lowest in bold, second underlined. Below each "
        f"value: its 95 % interval, by bootstrap over {first.clusters}. Shaded: the detector that was attacked."
    )


def _pictures(found: Findings) -> str:
    """A row per camouflage: its UV map, and the frames that the report's rule picks, with what a detector found."""
    picker = FramePicker(found.study.entries)
    detector = (found.white_box or found.detectors)[0]
    grid = picker.grid(detector)
    maps = {record.name: jpeg for record, jpeg in maps_of(found.study.entries)}
    rows = {
        found.titles_of_paints[paint]: [
            pages.image(maps[paint], "image/jpeg", f"UV map of {paint}") if paint in maps else "",
            *(pages.image(tile, "image/jpeg", f"{paint} seen by {detector}") for tile in tiles),
        ]
        for paint, tiles in grid.rows.items()
    }
    note = f"UV maps, and the same frames rendered by Cycles in each, with what {detector} finds. {picker.rule}"
    return pages.section("Pictures", pages.picture_grid(["UV map", *grid.titles], rows), note)


def _settings(found: Findings) -> str:
    rows = [(found.titles[key], _told(settings) or "–") for key, settings in found.settings.items()]
    body = _listing(("variant", "settings of its own"), rows) + "<h3>Common to all</h3>" + pages.facts(found.common)
    notes = found.experiment.notes
    return pages.section("Settings", pages.bullets(notes) + body if notes else body)


def _data(found: Findings, out: Path) -> str:
    files = ", ".join(f'<a href="{out.stem}{suffix}">{escape(out.stem + suffix)}</a>' for suffix in (".json", ".csv"))
    entries = found.study.entries
    rows = [
        (entry.weathers, str(len(entry.results.frames)), f"{entry.results.cluster_count} {entry.results.clusters}",
         f"{entry.weathers}/results.json")
        for entry in entries
    ]  # fmt: skip
    body = (
        '<div id="data">' + pages.commands([found.study.command])
        + _listing(("weathers", "frames", "bootstrap draws", "file"), rows)
        + f'<p class="note">All numbers of this page, at full precision: {files}.</p></div>'
    )  # fmt: skip
    if found.timings_s:
        body += "<h3>Time taken</h3>" + pages.facts({stage: f"{s:.0f} s" for stage, s in found.timings_s.items()})
    return pages.section("Where the numbers come from", body)


def _limits(found: Findings) -> list[str]:
    return ["Several claims are judged at once and each interval is for itself: of twenty true ties one is called."]


def _json(found: Findings, scores: Scores, verdicts: Sequence[Verdict]) -> bytes:
    name, version = FORMAT
    value: dict[str, Any] = {
        "format": name,
        "version": version,
        "experiment": found.experiment.name,
        "command": found.study.command,
        "detectors_of_average": found.detectors,
        "attacked": list(found.attacked),
        "rows": found.titles,
        "paints": {row: list(paints) for row, paints in found.paints.items()},
        "scores": {weathers: _scores(found, scores, weathers) for weathers in scores.weathers},
        "verdicts": [_verdict(verdict, found) for verdict in verdicts],
        "common": found.common,
        "settings": found.settings,
        "timings_s": found.timings_s,
    }
    return (json.dumps(value, indent=1, allow_nan=False) + "\n").encode()


def _scores(found: Findings, scores: Scores, weathers: str) -> dict[str, dict[str, Any]]:
    return {
        row: {
            **{name: asdict(scores.ap(row, [name], [weathers])) for name in scores.detectors},
            AVERAGE: asdict(scores.ap(row, found.detectors, [weathers])),
        }
        for row in found.titles
    }


def _verdict(verdict: Verdict, found: Findings) -> dict[str, Any]:
    def gap(value: Estimate) -> dict[str, float]:
        return {"gap": value.ap, "low": value.low, "high": value.high}

    return {
        "by": verdict.claim.by,
        "outcome": verdict.outcome,
        "sentence": verdict.sentence(found.titles),
        "comparisons": [
            {
                "better": one.better,
                "worse": one.worse,
                "outcome": one.outcome,
                **gap(one.gap),
                "parts": {scope: gap(value) for scope, value in one.by_scope.items()},
            }
            for one in verdict.comparisons
        ],
    }


def _told(settings: Mapping[str, Any]) -> str:
    return ", ".join(
        f"{name} ({_told(value)})" if isinstance(value, Mapping) else f"{name} {value}"
        for name, value in settings.items()
    )


def _listing(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    titles = "".join(f'<th scope="col">{escape(title)}</th>' for title in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    table = f'<table class="listing"><thead><tr>{titles}</tr></thead><tbody>{body}</tbody></table>'
    return f'<div class="scroll">{table}</div>'
