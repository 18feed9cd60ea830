"""The tables of a study: by detector, by defence, by vehicle."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from ...contract import load_camouflage
from ...study.defended import NO_DEFENCE
from ...study.families import family_of, in_table_order, is_own
from ...study.recorded import Recorded
from ...study.results import MEAN
from ...study.study import Entry, Study
from .model import AVERAGE, Block, Cell, Column, Row, Source, Table

PUBLISHED = "pre-trained"  # the average without the detectors of this project, which have seen its images
_DEFENCES = {NO_DEFENCE: "No defence", "lgs": "LGS", "pad": "PAD", "jpeg": "JPEG", "bits": "Bit depth"}


def weathers_title(weathers: str) -> str:
    return f"{weathers.capitalize()} weathers" if weathers in ("seen", "unseen") else weathers


def defence_title(defence: str) -> str:
    name, colon, options = defence.partition(":")
    title = _DEFENCES.get(name, name.capitalize())
    return f"{title} ({options})" if colon else title


def unique(values: Iterable[str]) -> list[str]:
    """Each value once, in order of first appearance."""
    return list(dict.fromkeys(values))


def vehicles_of(study: Study) -> list[str]:
    return unique(entry.vehicle for entry in study.entries)


def white_box_of(entry: Entry) -> dict[str, tuple[str, ...]]:
    """Paint -> the detectors it was optimized against, for paints that were.

    Raises:
        RaucaError: a camouflage that the study names is missing or damaged.
    """
    made = {paint: load_camouflage(path)[0].made.get("detector") for paint, path in entry.camouflages.items()}
    return {paint: tuple(names.split("+")) for paint, names in made.items() if isinstance(names, str)}


def tables_of(study: Study, base: Path) -> list[Table]:
    """Every table that the study has numbers for; sources are told relative to the folder ``base``."""
    vehicles = vehicles_of(study)
    tables = [_by_detector(study, vehicle, base, alone=len(vehicles) == 1) for vehicle in vehicles]
    defended = unique(entry.vehicle for entry in study.entries if entry.defence != NO_DEFENCE)
    tables += [_by_defence(study, vehicle, base, alone=len(vehicles) == 1) for vehicle in defended]
    tables += [_by_vehicle(study, base)] if len(vehicles) > 1 else []
    return [table for table in tables if table.blocks]


def _by_detector(study: Study, vehicle: str, base: Path, alone: bool) -> Table:
    entries = study.of(vehicle=vehicle, defence=NO_DEFENCE)
    category = entries[0].category if entries else ""
    return _table(
        "detectors" if alone else f"detectors-{vehicle}",
        "Average precision" if alone else f"Average precision: {vehicle}",
        f"{category.capitalize()} AP@0.5 of the {vehicle}, by detector.",
        [(weathers_title(entry.weathers), entry) for entry in entries],
        base,
    )


def _by_defence(study: Study, vehicle: str, base: Path, alone: bool) -> Table:
    """The undefended views of the same weathers come first, to compare with."""
    defended = [e for e in study.of(vehicle=vehicle) if e.defence != NO_DEFENCE]
    several = len({entry.weathers for entry in defended}) > 1
    blocks = []
    for weathers in unique(entry.weathers for entry in defended):
        entries = study.of(vehicle=vehicle, weathers=weathers)
        for entry in sorted(entries, key=lambda e: e.defence != NO_DEFENCE):
            where = f", {weathers_title(weathers).lower()}" if several else ""
            blocks.append((defence_title(entry.defence) + where, entry))
    views = "" if several else f" in {weathers_title(defended[0].weathers).lower()}"
    return _table(
        "defences" if alone else f"defences-{vehicle}",
        "Defences" if alone else f"Defences: {vehicle}",
        f"{defended[0].category.capitalize()} AP@0.5 of the {vehicle}{views}, each image defended before detection.",
        blocks,
        base,
    )


def _table(key: str, title: str, caption: str, blocks: Sequence[tuple[str, Entry]], base: Path) -> Table:
    names = in_table_order(unique(name for _, entry in blocks for name in entry.results.detectors))
    attacked = {name for _, entry in blocks for names in white_box_of(entry).values() for name in names}
    columns = [Column(name, family_of(name), is_own(name), name in attacked) for name in names]
    published = [name for name in names if not is_own(name)]
    if len(published) in (0, len(names)):
        averages = [Column(AVERAGE)]
    else:
        averages = [Column("all", AVERAGE), Column(PUBLISHED, AVERAGE)]
    drawn = [Block(heading, _rows(entry, names, published, len(averages) > 1, base)) for heading, entry in blocks]
    return Table(key, title, caption, (*columns, *averages), tuple(drawn))


def _rows(entry: Entry, names: Sequence[str], published: Sequence[str], split: bool, base: Path) -> tuple[Row, ...]:
    against, recorded = white_box_of(entry), Recorded(entry)
    here = [name for name in published if name in entry.results.detectors]
    rows = []
    for paint in entry.results.paints:
        cells = [estimate_cell(entry, paint, name, base, name in against.get(paint, ())) for name in (*names, MEAN)]
        if split and here:
            estimate = recorded.mean_over(here, paint)
            cells.append(Cell(estimate.ap, estimate.low, estimate.high, source(entry, base, "table", paint)))
        elif split:
            cells.append(None)
        rows.append(Row(paint, tuple(cells)))
    return tuple(rows)


def estimate_cell(entry: Entry, paint: str, detector: str, base: Path, white_box: bool = False) -> Cell | None:
    """The cell of a paint and a detector (or ``"mean"``); None where the entry has none."""
    estimate = entry.results.table.get(paint, {}).get(detector)
    if estimate is None:
        return None
    return Cell(estimate.ap, estimate.low, estimate.high, source(entry, base, "table", paint, detector), white_box)


def _by_vehicle(study: Study, base: Path) -> Table:
    entries = study.of(defence=NO_DEFENCE)
    vehicles = unique(entry.vehicle for entry in entries)
    category = {entry.vehicle: entry.category for entry in entries}
    blocks = []
    for weathers in unique(entry.weathers for entry in entries):
        here = {entry.vehicle: entry for entry in entries if entry.weathers == weathers}
        paints = unique(paint for entry in here.values() for paint in entry.results.paints)
        rows = [
            Row(p, tuple(estimate_cell(here[v], p, MEAN, base) if v in here else None for v in vehicles))
            for p in paints
        ]
        blocks.append(Block(weathers_title(weathers), tuple(rows)))
    columns = tuple(Column(vehicle, category[vehicle]) for vehicle in vehicles)
    caption = "AP@0.5 of each vehicle's own class, averaged over the detectors."
    return Table("vehicles", "Other vehicles", caption, columns, tuple(blocks))


def source(entry: Entry, base: Path, *keys: str) -> Source:
    """Where a number of the entry's results stands."""
    return Source(Path(os.path.relpath(entry.folder / "results.json", base)).as_posix(), keys)
