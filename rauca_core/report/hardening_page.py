"""A detector before and after hardening as one HTML file, and its numbers beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..study.harden import Hardened
from ..study.hardening import Gain, Gains
from ..study.hardening_record import FILE_NAME
from ..study.other_classes import OtherClasses
from ..study.results import Estimate
from ..study.study import Entry
from .frames import FramePicker, Grid
from .page import write_study_page
from .study_tables import sourced
from .table import Cell, Column, Row, Source, Table, listing, printed

COLUMNS = (
    Column("AP@0.5 before"), Column("after"), Column("change", kind="change"), Column("recovered", kind="share"),
    Column("made", kind="text"),
)  # fmt: skip


MEASURES = {
    "clean": "own paint", "held_out": "held-out camouflages", "held_out_methods": "held-out methods",
    "held_out_vehicle": "held-out vehicle", "held_out_weathers": "held-out weathers",
    **{f"adaptive_{k}x": f"adaptive, {k} times the budget" for k in (1, 3, 10)},
}  # fmt: skip
_LIMITS = (
    "The held-out camouflages were optimized against the detector before hardening and never trained on. The adaptive "
    "ones were optimized against the hardened detector: they say how far an attack of that length gets, and a longer "
    "or another one may get farther.",
    "One vehicle or a few, rendered: nothing here was measured on photographs.",
)


def write_hardening(found: Hardened, out: Path) -> list[Path]:
    """Write the page to ``out`` (.html), and its numbers (.csv, .json, .tex) beside it; returns all, the page first.

    Raises:
        RaucaError: images or detections that are missing or have changed; then nothing was written.
    """
    tables = [gains_table(gains, found) for gains in found.gains]
    told: dict[str, Any] = {
        "title": f"{found.before}, hardened",
        "lead": [*map(_sentence, found.gains), *sentences(found)],
        "figures": _figures(found),
        "rounds": _rounds(found),
        "others": _others(found),
        "tables": list(zip(tables, found.gains, strict=True)),
        "pictures": [(gains.entry, *_pictures(gains.entry, found)) for gains in found.gains],
    }
    about = {"before": found.before, "after": found.after, "made": found.made, "settings": found.facts}
    every = [told["figures"], *tables, told["others"], told["rounds"]]
    return write_study_page(found.study, out, "hardening.html", told, every, about, found.facts, limits=_LIMITS)


def gains_table(gains: Gains, found: Hardened) -> Table:
    """A row per paint, the vehicle's own first and the mean over the held-out ones last."""
    entry = gains.entry

    def row(gain: Gain, *keys: str) -> Row:
        def cell(estimate: Estimate, *detector: str) -> Cell:
            return sourced(estimate, entry, "table", *keys, *(detector if keys else ()))

        share = None if gain.recovered is None else cell(gain.recovered)
        told = cell(gain.before, found.before), cell(gain.after, found.after), cell(gain.change), share
        return Row(gain.paint, (*told, Cell(found.made.get(gain.paint, ""))))

    title = f"Before and after: {entry.vehicle}, {entry.weathers}"
    rows = tuple(row(gain, *([gain.paint] if gain.paint in entry.results.paints else [])) for gain in _rows(gains))
    return listing(f"hardening-{entry.vehicle}-{entry.weathers}", "paint", COLUMNS, rows, title)


def _rows(gains: Gains) -> list[Gain]:
    """The vehicle's own paint, every other one, and the means over held-out ones."""
    means = (gains.held_out, gains.methods)
    return [gains.clean, *gains.rows, *(mean for mean in means if mean is not None)]


def sentences(found: Hardened) -> list[str]:
    """What holds for all entries: other classes, cost, attacks that failed."""
    figures, told = found.figures, []
    if share := figures.other_classes.estimate:
        both, places = figures.other_classes.both, figures.other_classes.places
        told.append(
            f"Of {both.objects} objects beside the vehicle, and in pictures without it, that one of the two detectors "
            f"was sure of, the other says the same of {share.ap:.1%} (95 % interval {share.low:.0%} to {share.high:.0%}"
            f" over {places} {'place' if places == 1 else 'places'}; one object counts once in each paint). Of the "
            f"{both.known} that {figures.before} was sure of, {figures.after} still finds {both.kept}."
        )
    told.append(f"The hardening took {figures.cost.cpu_minutes:.1f} CPU minutes, attacks and tests included.")
    if figures.failed:
        told.append(
            f"Failed attacks: {'; '.join(figures.failed)}. They know the hardened detector and end above camouflages "
            "that do not: they say nothing of how robust it is, and a stronger attack is needed."
        )
    return told


def _figures(found: Hardened) -> Table:
    """Each measure of ``hardening.json`` where it ends lowest."""

    def row(key: str, gain: Gain) -> Row:
        before, after, recovered = (Source(FILE_NAME, (key, name)) for name in ("before", "after", "recovered"))
        share = None if gain.recovered is None else Cell(gain.recovered.ap, source=recovered)
        ended = Cell(gain.after.ap, gain.after.low, gain.after.high, after)
        return Row(MEASURES.get(key, key), (Cell(gain.before.ap, source=before), ended, share))

    rows = [row(key, gain) for key, gain in found.figures.worst().items() if gain is not None]
    columns = (Column("AP@0.5 before"), Column("after"), Column("recovered", kind="share"))
    return listing("hardening-figures", "measure", columns, tuple(rows), "What it is measured by")


def _others(found: Hardened) -> Table:
    """What both detectors say of everything but the vehicle, by vehicle and weathers."""
    columns = (
        Column("the same", kind="share"), Column("still found", kind="share"), Column("objects", kind="count"),
        Column("places", kind="count"),
    )  # fmt: skip

    def row(name: str, one: OtherClasses, *keys: str) -> Row:
        def source(key: str) -> Source:
            return Source(FILE_NAME, (*keys, key))

        share, kept, objects = one.estimate, one.both.kept_share, one.both.objects
        same = None if share is None else Cell(share.ap, share.low, share.high, source("agreement"))
        still = None if kept is None else Cell(kept)
        return Row(
            name, (same, still, Cell(objects, source=source("objects")), Cell(one.places, source=source("places")))
        )

    figures = found.figures
    rows = [
        row(f"{one.entry.vehicle}, {one.entry.weathers}", others, "entries", str(number), "other_classes")
        for number, (one, others) in enumerate(zip(figures.gains, figures.others, strict=True))
    ]
    rows += [
        row(f"more places, {weathers}", others, "other_places", weathers)
        for weathers, others in figures.other_places.items()
    ]
    rows = [*rows, row("all", figures.other_classes, "other_classes")]
    return listing("hardening-others", "views", columns, tuple(rows), "Other objects")


def _rounds(found: Hardened) -> Table:
    """Where the gain flattens, on frames that training held out."""
    columns = (
        Column("plain paint"), Column("in the round's camouflage"), Column("CPU minutes", kind="number")
    )  # fmt: skip
    rows = [
        Row(str(one.round), (
            Cell(one.plain), None if one.camouflaged is None else Cell(one.camouflaged), Cell(one.cpu_minutes),
        ))
        for one in found.figures.cost.rounds
    ]  # fmt: skip
    return listing("hardening-rounds", "round", columns, tuple(rows), "Round by round")


def _sentence(gains: Gains) -> str:
    entry, mean, clean = gains.entry, gains.held_out or gains.unseen or gains.clean, gains.clean
    what = "held-out camouflages" if gains.held_out else "a camouflage on a vehicle that was never shown"
    share = "nothing was lost" if mean.recovered is None else f"{mean.recovered.ap:.0%} of the loss recovered"
    return (
        f"{entry.vehicle}, {entry.weathers} weathers: on {what} AP@0.5 {printed(mean.before.ap)} before "
        f"and {printed(mean.after.ap)} after ({share}); in its own paint {printed(clean.before.ap)} before and "
        f"{printed(clean.after.ap)} after."
    )


def _pictures(entry: Entry, found: Hardened) -> tuple[FramePicker, Grid]:
    """The same views before and after, paint by paint."""
    picker = FramePicker([entry])
    which = f" on the {entry.vehicle}, {entry.weathers}"
    before = picker.grid(found.before, f"{which}, before hardening")
    after = picker.grid(found.after, f"{which}, after it")
    grids = {"before": before, "after": after}
    rows = {f"{paint}, {when}": grid.rows[paint] for paint in picker.paints for when, grid in grids.items()}
    return picker, Grid(before.titles, rows)
