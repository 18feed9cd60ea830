"""A detector before and after hardening as one HTML file, and its numbers beside it."""

from __future__ import annotations

from pathlib import Path

from ..study.harden import Hardened
from ..study.hardening import Gain, Gains
from ..study.results import Estimate
from ..study.study import Entry
from .frames import FramePicker, Grid
from .page import write_study_page
from .study_tables import sourced
from .table import Cell, Column, Row, Table, listing, printed

COLUMNS = (
    Column("AP@0.5 before"), Column("after"), Column("change", kind="change"), Column("recovered", kind="share"),
    Column("made", kind="text"),
)  # fmt: skip


_LIMITS = (
    "The held-out camouflages were optimized against the detector before hardening and never trained on. The adaptive "
    "one was optimized against the hardened detector: it says how far a new attack of the same kind gets, and a longer "
    "or another one may get farther.",
    "One vehicle or a few, rendered: nothing here was measured on photographs.",
)


def write_hardening(found: Hardened, out: Path) -> list[Path]:
    """Write the page to ``out`` (.html), and its numbers (.csv, .json, .tex) beside it; returns all, the page first.

    Raises:
        RaucaError: images or detections that are missing or have changed; then nothing was written.
    """
    tables = [_table(gains, found) for gains in found.gains]
    told = {
        "title": f"{found.before}, hardened",
        "lead": [_sentence(gains) for gains in found.gains],
        "tables": list(zip(tables, found.gains, strict=True)),
        "pictures": [(gains.entry, *_pictures(gains.entry, found)) for gains in found.gains],
    }
    about = {"before": found.before, "after": found.after, "made": found.made, "settings": found.facts}
    return write_study_page(found.study, out, "hardening.html", told, tables, about, found.facts, limits=_LIMITS)


def _table(gains: Gains, found: Hardened) -> Table:
    """A row per paint, the vehicle's own first and the mean over the held-out ones last."""
    entry = gains.entry

    def row(gain: Gain, *keys: str) -> Row:
        def cell(estimate: Estimate, *detector: str) -> Cell:
            return sourced(estimate, entry, "table", *keys, *(detector if keys else ()))

        share = None if gain.recovered is None else cell(gain.recovered)
        told = cell(gain.before, found.before), cell(gain.after, found.after), cell(gain.change), share
        return Row(gain.paint, (*told, Cell(found.made.get(gain.paint, ""))))

    title = f"Before and after: {entry.vehicle}, {entry.weathers}"
    rows = (*(row(gain, gain.paint) for gain in (gains.clean, *gains.rows)), row(gains.held_out))
    return listing(f"hardening-{entry.vehicle}-{entry.weathers}", "paint", COLUMNS, rows, title)


def _sentence(gains: Gains) -> str:
    entry, mean, clean = gains.entry, gains.held_out, gains.clean
    share = "nothing was lost" if mean.recovered is None else f"{mean.recovered.ap:.0%} of the loss recovered"
    return (
        f"{entry.vehicle}, {entry.weathers} weathers: on held-out camouflages AP@0.5 {printed(mean.before.ap)} before "
        f"and {printed(mean.after.ap)} after ({share}); in its own paint {printed(clean.before.ap)} before and "
        f"{printed(clean.after.ap)} after."
    )


def _pictures(entry: Entry, found: Hardened) -> tuple[FramePicker, Grid]:
    """The same views before and after, paint by paint."""
    picker = FramePicker([entry])
    before, after = picker.grid(found.before, ", before hardening"), picker.grid(found.after, ", after it")
    grids = {"before": before, "after": after}
    rows = {f"{paint}, {when}": grid.rows[paint] for paint in picker.paints for when, grid in grids.items()}
    return picker, Grid(before.titles, rows)
