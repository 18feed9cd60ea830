"""The report of a hardening: one HTML file, its numbers beside it as CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from .. import __version__
from ..contract.files import write_bytes
from ..study.hardening import Gain, Gains
from ..study.results import Estimate
from ..study.study import Entry
from . import pages
from .grid import PICTURE_THRESHOLD, FramePicker

FORMAT = ("rauca-hardening-report", 1)
HEAD = ("paint", "AP@0.5 before", "after", "change", "recovered")


@dataclass(frozen=True)
class HardeningNotes:
    """What the numbers alone do not say.

    Attributes:
        before, after: the detectors' names.
        notes: paint -> how it was made.
        facts: name -> value, as the reader should see them.
        command: that made it all.
    """

    before: str
    after: str
    notes: Mapping[str, str]
    facts: Mapping[str, object]
    command: str
    limitations: Sequence[str] = field(default_factory=tuple)


def write_hardening(gains: Sequence[Gains], entries: Sequence[Entry], out: Path, notes: HardeningNotes) -> list[Path]:
    """Write the page to ``out`` (.html), and ``.csv`` and ``.json`` beside it; returns all, the page first.

    Args:
        gains: one for each of ``entries``.

    Raises:
        RaucaError: images or detections that are missing or have changed; then nothing was written.
    """
    title = f"{notes.before}, hardened"
    sections = [
        *(_table(one, notes) for one in gains),
        *(_pictures(entry, notes) for entry in entries),
        pages.section("How it was made", pages.commands([notes.command]) + pages.facts(notes.facts)),
        pages.section("What this does not say", pages.bullets(notes.limitations)),
    ]
    header = f"<h1>{escape(title)}</h1>" + "".join(pages.paragraph(_sentence(one), "lead") for one in gains)
    page = pages.page(title, header, sections, f"Written by rauca {escape(__version__)}.")
    files = {".html": page.encode(), ".csv": _csv(gains).encode(), ".json": _json(gains, notes).encode()}
    for suffix, data in files.items():
        write_bytes(out.with_suffix(suffix), data)
    return [out.with_suffix(suffix) for suffix in files]


def _sentence(gains: Gains) -> str:
    mean, clean = gains.held_out, gains.clean
    share = "nothing was lost" if mean.recovered is None else f"{mean.recovered.ap:.0%} of the loss recovered"
    return (
        f"{gains.vehicle}, {gains.weathers} weathers: on held-out camouflages AP@0.5 {mean.before.ap:.3f} before and "
        f"{mean.after.ap:.3f} after ({share}); in its own paint {clean.before.ap:.3f} before and {clean.after.ap:.3f} "
        "after."
    )


def _table(gains: Gains, notes: HardeningNotes) -> str:
    head = "".join(f'<th scope="col">{escape(name)}</th>' for name in (*HEAD, "made"))
    rows = "".join(_row(gain, notes) for gain in (gains.clean, *gains.rows, gains.held_out))
    body = (
        f'<div class="scroll"><table class="listing"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'
    )
    note = (
        f"{gains.frames} held-out views rendered by Cycles in every paint. In brackets: 95 % intervals by a bootstrap "
        f"over {gains.draws}, shared by all rows and both detectors. Recovered: (after - before) / (own paint before "
        "- before); 100 % means as good as the first detector was on the plain vehicle."
    )
    return pages.section(f"Before and after: {gains.vehicle}, {gains.weathers}", body, note)


def _row(gain: Gain, notes: HardeningNotes) -> str:
    share = "–" if gain.recovered is None else spoken(gain.recovered, percent=True)
    cells = [spoken(gain.before), spoken(gain.after), spoken(gain.change, sign=True), share]
    cells.append(notes.notes.get(gain.paint, ""))
    return f'<tr><th scope="row">{escape(gain.paint)}</th>' + "".join(f"<td>{escape(c)}</td>" for c in cells) + "</tr>"


def spoken(estimate: Estimate, percent: bool = False, sign: bool = False) -> str:
    """An estimate with its interval, as tables show it."""
    if percent:
        return f"{estimate.ap:.0%} [{estimate.low:.0%}, {estimate.high:.0%}]"
    plus = "+" if sign else ""
    return f"{estimate.ap:{plus}.3f} [{estimate.low:{plus}.2f}, {estimate.high:{plus}.2f}]"


def _pictures(entry: Entry, notes: HardeningNotes) -> str:
    """The same views before and after, paint by paint."""
    picker = FramePicker([entry])
    grids = {when: picker.grid(name) for when, name in (("before", notes.before), ("after", notes.after))}
    titles = grids["before"].titles
    rows = {
        f"{paint}, {when}": [
            pages.image(tile, "image/jpeg", f"{paint}, {title.replace(chr(10), ', ')}, {when} hardening")
            for title, tile in zip(titles, grid.rows[paint], strict=True)
        ]
        for paint in picker.paints
        for when, grid in grids.items()
    }
    note = (
        f"{picker.rule} Cut out around the vehicle. Thin white: the true box. Detections that score "
        f"{PICTURE_THRESHOLD} or more: blue finds the {entry.category}, red reports one elsewhere, yellow takes it, or "
        "something else, for another thing."
    )
    title = f"What the detector sees: {entry.vehicle}, {entry.weathers}"
    return pages.section(title, pages.picture_grid(titles, rows), note)


def _csv(gains: Sequence[Gains]) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    ends = ("ap", "low", "high")
    names = [f"{what}_{end}" for what in ("before", "after", "change", "recovered") for end in ends]
    writer.writerow(["vehicle", "weathers", "paint", *names])
    for one in gains:
        for gain in (one.clean, *one.rows, one.held_out):
            found = (gain.before, gain.after, gain.change, gain.recovered)
            values = [getattr(estimate, end) if estimate else "" for estimate in found for end in ends]
            writer.writerow([one.vehicle, one.weathers, gain.paint, *values])
    return stream.getvalue()


def _json(gains: Sequence[Gains], notes: HardeningNotes) -> str:
    name, version = FORMAT
    value = {
        "format": name,
        "version": version,
        "command": notes.command,
        "before": notes.before,
        "after": notes.after,
        "made": dict(notes.notes),
        "settings": dict(notes.facts),
        "gains": [one.to_json() for one in gains],
    }
    return json.dumps(value, indent=1, allow_nan=False) + "\n"
