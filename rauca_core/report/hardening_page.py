"""A detector before and after hardening as one HTML file, and its numbers beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..study.hardening import Gain, Gains
from ..study.results import Estimate
from ..study.study import Entry, Study
from .frames import FramePicker, Grid
from .page import write_study_page
from .study_tables import sourced
from .table import Cell, Column, Row, Table, listing, printed

COLUMNS = (
    Column("AP@0.5 before"), Column("after"), Column("change", kind="change"), Column("recovered", kind="share"),
    Column("made", kind="text"),
)  # fmt: skip


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
    """Write the page to ``out`` (.html), and its numbers (.csv, .json, .tex) beside it; returns all, the page first.

    Args:
        gains: one for each of ``entries``.

    Raises:
        RaucaError: images or detections that are missing or have changed; then nothing was written.
    """
    study, base = Study(notes.command, tuple(entries)), out.parent
    tables = [hardening_table(one, entry, base, notes) for one, entry in zip(gains, entries, strict=True)]
    told = {
        "title": f"{notes.before}, hardened",
        "lead": [_sentence(one) for one in gains],
        "tables": list(zip(tables, gains, strict=True)),
        "pictures": [(entry, *_pictures(entry, notes)) for entry in entries],
    }
    about = {
        "before": notes.before, "after": notes.after, "made": dict(notes.notes), "settings": dict(notes.facts),
    }  # fmt: skip
    return write_study_page(study, out, "hardening.html", told, tables, about, notes.facts, limits=notes.limitations)


def hardening_table(gains: Gains, entry: Entry, base: Path, notes: HardeningNotes) -> Table:
    """A row per paint, the vehicle's own first and the mean over the held-out ones last."""

    def row(gain: Gain, *keys: str) -> Row:
        def cell(estimate: Estimate, *detector: str) -> Cell:
            return sourced(estimate, entry, base, "table", *keys, *(detector if keys else ()))

        share = None if gain.recovered is None else cell(gain.recovered)
        told = cell(gain.before, notes.before), cell(gain.after, notes.after), cell(gain.change), share
        return Row(gain.paint, (*told, Cell(notes.notes.get(gain.paint, ""))))

    title = f"Before and after: {gains.vehicle}, {gains.weathers}"
    rows = (*(row(gain, gain.paint) for gain in (gains.clean, *gains.rows)), row(gains.held_out))
    return listing(f"hardening-{gains.vehicle}-{gains.weathers}", "paint", COLUMNS, rows, title)


def _sentence(gains: Gains) -> str:
    mean, clean = gains.held_out, gains.clean
    share = "nothing was lost" if mean.recovered is None else f"{mean.recovered.ap:.0%} of the loss recovered"
    return (
        f"{gains.vehicle}, {gains.weathers} weathers: on held-out camouflages AP@0.5 {printed(mean.before.ap)} before "
        f"and {printed(mean.after.ap)} after ({share}); in its own paint {printed(clean.before.ap)} before and "
        f"{printed(clean.after.ap)} after."
    )


def _pictures(entry: Entry, notes: HardeningNotes) -> tuple[FramePicker, Grid]:
    """The same views before and after, paint by paint."""
    picker = FramePicker([entry])
    before, after = picker.grid(notes.before, ", before hardening"), picker.grid(notes.after, ", after it")
    grids = {"before": before, "after": after}
    rows = {f"{paint}, {when}": grid.rows[paint] for paint in picker.paints for when, grid in grids.items()}
    return picker, Grid(before.titles, rows)
