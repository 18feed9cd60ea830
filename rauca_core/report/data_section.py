"""Where every number of the report comes from: commands, files, detectors, settings."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Protocol
from urllib.parse import quote

from ..study.families import family_of, in_table_order, is_own
from ..study.study import Entry, Study
from . import pages
from .tables import white_box_of
from .tables.of_study import defence_title, unique, weathers_title


class Notes(Protocol):
    """The part of the report's notes that belongs here."""

    @property
    def settings(self) -> Mapping[str, object]: ...
    @property
    def commands(self) -> Sequence[str]: ...
    @property
    def timings_s(self) -> Mapping[str, float]: ...


def anchors_of(study: Study, base: Path) -> dict[str, str]:
    """File of results, relative to ``base`` -> id of its row on the page."""
    return {_file(entry, base): f"data-{number}" for number, entry in enumerate(study.entries, start=1)}


def data_section(study: Study, base: Path, notes: Notes, beside: Sequence[str]) -> str:
    """``beside``: names of the files that hold the page's numbers."""
    links = ", ".join(f'<a href="{quote(name)}">{escape(name)}</a>' for name in beside)
    first = study.entries[0].results
    body = (
        "<h3>Command</h3>"
        + pages.commands(unique([study.command, *notes.commands]))
        + "<h3>Results</h3>"
        + _results(study, base)
        + f'<p class="note">All numbers of this page, at full precision: {links}.</p>'
        + "<h3>Detectors</h3>"
        + _detectors(study)
        + "<h3>Settings</h3>"
        + pages.facts(
            {
                "lowest score counted": first.settings.score_threshold,
                "overlap of non-maximum suppression": first.settings.iou_threshold,
                "bootstrap": f"{first.resamples} resamples of {first.clusters}, seed {first.seed}, 95 % interval",
                **notes.settings,
            }
        )
    )
    if notes.timings_s:
        body += "<h3>Time taken</h3>" + pages.facts({stage: f"{s:.1f} s" for stage, s in notes.timings_s.items()})
    note = "Each number above links to its row below; hover over it for the place inside the file."
    return pages.section("Where the numbers come from", body, note)


def _results(study: Study, base: Path) -> str:
    several = len(unique(entry.vehicle for entry in study.entries)) > 1
    head = ["vehicle"] * several + ["weathers", "defence", "frames", "left out", "bootstrap draws", "file", "sha256"]
    rows = [_result(entry, base, f"data-{n}", several) for n, entry in enumerate(study.entries, start=1)]
    return _listing(head, rows)


def _result(entry: Entry, base: Path, anchor: str, several: bool) -> str:
    results, file = entry.results, _file(entry, base)
    digest = hashlib.sha256((entry.folder / "results.json").read_bytes()).hexdigest()
    draws = f"{results.cluster_count} {results.clusters}" if results.cluster_count else results.clusters
    cells = [
        *([entry.vehicle] if several else []),
        weathers_title(entry.weathers),
        defence_title(entry.defence),
        str(len(results.frames)),
        str(len(results.dropped)),
        draws,
    ]
    link = f'<a href="{quote(file)}">{escape(file)}</a>'
    return (
        f'<tr id="{anchor}">'
        + "".join(f"<td>{escape(c)}</td>" for c in cells)
        + (f"<td>{link}</td><td><code>{digest[:16]}</code></td></tr>")
    )


def _detectors(study: Study) -> str:
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
        cells = "".join(f"<td>{escape(cell)}</td>" for cell in (name, family_of(name), trained, met))
        rows.append(f"<tr>{cells}<td><code>{escape(prints[name][:16])}</code></td></tr>")
    return _listing(["detector", "family", "trained on", "white-box for", "fingerprint"], rows)


def _listing(head: Sequence[str], rows: Sequence[str]) -> str:
    titles = "".join(f'<th scope="col">{escape(title)}</th>' for title in head)
    return (
        f'<div class="scroll"><table class="listing"><thead><tr>{titles}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )


def _file(entry: Entry, base: Path) -> str:
    return Path(os.path.relpath(entry.folder / "results.json", base)).as_posix()
