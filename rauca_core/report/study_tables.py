"""The tables of a study: by detector, by defence, by vehicle, along one parameter."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ..study.defences import NO_DEFENCE
from ..study.detectors import family_of, in_table_order, is_own
from ..study.results import AXES, MEAN, Estimate
from ..study.scores import Recorded
from ..study.study import Entry, Study, white_box_of
from .table import AVERAGE, Block, Cell, Column, Row, Source, Table

PUBLISHED = "pre-trained"  # the average without the detectors of this project, which have seen its images
AXIS_TITLES = {
    "azimuth_deg": "Azimuth (°), 0 = front",
    "elevation_deg": "Camera elevation (°)",
    "distance_m": "Distance (m)",
    "sun_altitude_deg": "Sun altitude (°)",
    "fog_density": "Fog density (CARLA, 0-100)",
}
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


def sourced(estimate: Estimate, entry: Entry, *keys: str, white_box: bool = False) -> Cell:
    """The cell of a number that stands in the entry's results under ``keys``, or is computed from what stands there."""
    return Cell(estimate.ap, estimate.low, estimate.high, Source(entry.folder / "results.json", keys), white_box)


def detector_columns(names: Sequence[str], attacked: Iterable[str]) -> tuple[Column, ...]:
    """A column per detector, under its family."""
    met = set(attacked)
    return tuple(Column(name, family_of(name), is_own(name), name in met) for name in names)


def tables_of(study: Study) -> list[Table]:
    """Every table that the study has numbers for."""
    vehicles = vehicles_of(study)
    tables = [_by_detector(study, vehicle) for vehicle in vehicles]
    tables += [_by_defence(study, vehicle) for vehicle in vehicles]
    tables += [_by_vehicle(study)] if len(vehicles) > 1 else []
    return [table for table in tables if table.blocks]


def _by_detector(study: Study, vehicle: str) -> Table:
    blocks = [(weathers_title(entry.weathers), entry) for entry in study.of(vehicle=vehicle, defence=NO_DEFENCE)]
    return _table("detectors", "Average precision", "by detector", study, vehicle, blocks)


def _by_defence(study: Study, vehicle: str) -> Table:
    """The undefended views of the same weathers come first, to compare with."""
    defended = unique(e.weathers for e in study.of(vehicle=vehicle) if e.defence != NO_DEFENCE)
    blocks = []
    for weathers in defended:
        where = f", {weathers_title(weathers).lower()}" if len(defended) > 1 else ""
        entries = study.of(vehicle=vehicle, weathers=weathers)
        ordered = sorted(entries, key=lambda entry: entry.defence != NO_DEFENCE)
        blocks += [(defence_title(entry.defence) + where, entry) for entry in ordered]
    views = f"in {weathers_title(defended[0]).lower()}, " if len(defended) == 1 else ""
    what = f"{views}each image defended before detection"
    return _table("defences", "Defences", what, study, vehicle, blocks)


def _table(key: str, title: str, what: str, study: Study, vehicle: str, blocks: Sequence[tuple[str, Entry]]) -> Table:
    """AP of paints and detectors of one of the study's vehicles, a block per (title, entry)."""
    names = in_table_order(unique(name for _, entry in blocks for name in entry.results.detectors))
    attacked = [name for _, entry in blocks for names in white_box_of(entry).values() for name in names]
    published = [name for name in names if not is_own(name)]
    if len(published) in (0, len(names)):
        averages = [Column(AVERAGE)]
    else:
        averages = [Column("all", AVERAGE), Column(PUBLISHED, AVERAGE)]
    drawn = [Block(heading, _rows(entry, names, published, len(averages) > 1)) for heading, entry in blocks]
    category = blocks[0][1].category.capitalize() if blocks else ""
    caption = f"{category} AP@0.5 of the {vehicle}, {what}."
    of = ("", "") if len(vehicles_of(study)) == 1 else (f"-{vehicle}", f": {vehicle}")
    return Table(key + of[0], title + of[1], caption, (*detector_columns(names, attacked), *averages), tuple(drawn))


def _rows(entry: Entry, names: Sequence[str], published: Sequence[str], split: bool) -> tuple[Row, ...]:
    against, recorded = white_box_of(entry), Recorded(entry)
    here = [name for name in published if name in entry.results.detectors]
    rows = []
    for paint in entry.results.paints:
        cells = [_cell(entry, paint, name, name in against.get(paint, ())) for name in (*names, MEAN)]
        if split:
            cells.append(sourced(recorded.mean_over(here, paint), entry, "table", paint) if here else None)
        rows.append(Row(paint, tuple(cells)))
    return tuple(rows)


def _cell(entry: Entry, paint: str, detector: str, white_box: bool = False) -> Cell | None:
    """The cell of a paint and a detector (or ``"mean"``); None where the entry has none."""
    found = entry.results.table.get(paint, {}).get(detector)
    return None if found is None else sourced(found, entry, "table", paint, detector, white_box=white_box)


def _by_vehicle(study: Study) -> Table:
    entries = study.of(defence=NO_DEFENCE)
    category = {entry.vehicle: entry.category for entry in entries}
    blocks = []
    for weathers in unique(entry.weathers for entry in entries):
        here = {entry.vehicle: entry for entry in entries if entry.weathers == weathers}
        paints = unique(paint for entry in here.values() for paint in entry.results.paints)
        cells = [[_cell(here[v], paint, MEAN) if v in here else None for v in category] for paint in paints]
        rows = tuple(Row(paint, tuple(row)) for paint, row in zip(paints, cells, strict=True))
        blocks.append(Block(weathers_title(weathers), rows))
    columns = tuple(Column(vehicle, of) for vehicle, of in category.items())
    caption = "AP@0.5 of each vehicle's own class, averaged over the detectors."
    return Table("vehicles", "Other vehicles", caption, columns, tuple(blocks))


def curves_of(study: Study) -> dict[str, list[Table]]:
    """Weathers -> a table per parameter that varies there, whose columns are its values.

    Of the first vehicle, undefended, mean over detectors.
    """
    entries = study.of(vehicle=vehicles_of(study)[0], defence=NO_DEFENCE)
    return {
        entry.weathers: [_curve(entry, axis) for axis in AXES if len(entry.results.groups[axis]) > 1]
        for entry in entries
    }


def _curve(entry: Entry, axis: str) -> Table:
    groups = entry.results.groups[axis]
    rows = []
    for paint in entry.results.paints:
        places = [("groups", axis, str(index), "mean", paint) for index in range(len(groups))]
        cells = [sourced(group.mean[paint], entry, *keys) for group, keys in zip(groups, places, strict=True)]
        rows.append(Row(paint, tuple(cells)))
    sizes = sorted({group.frames for group in groups})
    frames = f"{sizes[0]}" if len(sizes) == 1 else f"{sizes[0]} to {sizes[-1]}"
    caption = f"{AXIS_TITLES[axis]}: {frames} frame{'' if frames == '1' else 's'} per value."
    columns = tuple(Column(f"{group.value:g}") for group in groups)
    key = f"{axis.partition('_')[0]}-{entry.weathers}"
    return Table(key, AXIS_TITLES[axis], caption, columns, (Block(weathers_title(entry.weathers), tuple(rows)),))
