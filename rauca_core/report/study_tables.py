"""The tables of a study: by detector, by defence, by vehicle, along one parameter."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from ..study.defences import NO_DEFENCE
from ..study.detectors import family_of, in_table_order, is_own
from ..study.parts import ATTACKED, OWN, RELATIVE, TOOK_NO_PART, attacked_by, leading, parts_of
from ..study.results import AXES, Estimate
from ..study.study import Entry, Study
from .table import AVERAGE, Block, Cell, Column, Row, Source, Table

AXIS_TITLES = {
    "azimuth_deg": "Azimuth (°), 0 = front",
    "elevation_deg": "Camera elevation (°)",
    "distance_m": "Distance (m)",
    "sun_altitude_deg": "Sun altitude (°)",
    "fog_density": "Fog density (CARLA, 0-100)",
}
_WHICH = {
    TOOK_NO_PART: "that took no part in the attacks",
    RELATIVE: "of an attacked one's family",
    ATTACKED: "among the attacked",
    OWN: "of this project's own",
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


def counted(number: int, what: str) -> str:
    """``"1 detector"``, ``"2 detectors"``."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def vehicles_of(study: Study) -> list[str]:
    return unique(entry.vehicle for entry in study.entries)


def sourced(estimate: Estimate, entry: Entry, *keys: str, white_box: bool = False) -> Cell:
    """The cell of a number that stands in the entry's results under ``keys``, or is computed from what stands there."""
    return Cell(estimate.ap, estimate.low, estimate.high, Source(entry.folder / "results.json", keys), white_box)


def detector_columns(names: Sequence[str], attacked: Iterable[str]) -> tuple[Column, ...]:
    """A column per detector, under its family."""
    met = set(attacked)
    return tuple(Column(name, family_of(name), is_own(name), name in met) for name in names)


def average_columns(parts: Mapping[str, Sequence[str]]) -> tuple[Column, ...]:
    """A column per part that detectors had in the attacks, under one heading. They stand first: tables of many
    detectors are wider than a window.
    """
    return (Column(AVERAGE),) if len(parts) == 1 else tuple(Column(part, AVERAGE) for part in parts)


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
    attacked = [name for _, entry in blocks for names in entry.against.values() for name in names]
    parts = parts_of(names, attacked)
    drawn = [Block(heading, _rows(entry, names, parts)) for heading, entry in blocks]
    category = blocks[0][1].category.capitalize() if blocks else ""
    caption = f"{category} AP@0.5 of the {vehicle}, {what}."
    of = ("", "") if len(vehicles_of(study)) == 1 else (f"-{vehicle}", f": {vehicle}")
    columns = (*average_columns(parts), *detector_columns(names, attacked))
    return Table(key + of[0], title + of[1], caption, columns, tuple(drawn))


def _rows(entry: Entry, names: Sequence[str], parts: Mapping[str, Sequence[str]]) -> tuple[Row, ...]:
    against, here = entry.against, entry.results.detectors
    rows = []
    for paint in entry.results.paints:
        means: list[Cell | None] = []
        for part, some in parts.items():
            met = attacked_by(parts, against.get(paint, ())) if part == ATTACKED else some
            averaged = [name for name in met if name in here]
            means.append(
                sourced(entry.recorded.mean_over(averaged, paint), entry, "table", paint) if averaged else None
            )
        cells = [_cell(entry, paint, name, name in against.get(paint, ())) for name in names]
        rows.append(Row(paint, (*means, *cells)))
    return tuple(rows)


def _cell(entry: Entry, paint: str, detector: str, white_box: bool = False) -> Cell | None:
    """The cell of a paint and a detector; None where the entry has none."""
    found = entry.results.table.get(paint, {}).get(detector)
    return None if found is None else sourced(found, entry, "table", paint, detector, white_box=white_box)


def _by_vehicle(study: Study) -> Table:
    entries = study.of(defence=NO_DEFENCE)
    category = {entry.vehicle: entry.category for entry in entries}
    blocks = []
    for weathers in unique(entry.weathers for entry in entries):
        here = {entry.vehicle: entry for entry in entries if entry.weathers == weathers}
        paints = unique(paint for entry in here.values() for paint in entry.results.paints)
        cells = [[_mean(here[v], paint) if v in here else None for v in category] for paint in paints]
        rows = tuple(Row(paint, tuple(row)) for paint, row in zip(paints, cells, strict=True))
        blocks.append(Block(weathers_title(weathers), rows))
    columns = tuple(Column(vehicle, of) for vehicle, of in category.items())
    told = "; ".join(unique(averaged_over(entry) for entry in entries))
    caption = f"AP@0.5 of each vehicle's own class, {told}."
    return Table("vehicles", "Other vehicles", caption, columns, tuple(blocks))


def _mean(entry: Entry, paint: str) -> Cell | None:
    """A paint's mean over the leading part of the detectors; None where the entry lacks the paint."""
    if paint not in entry.results.table:
        return None
    return sourced(entry.recorded.mean_over(leading(entry.parts)[1], paint), entry, "table", paint)


def averaged_over(entry: Entry) -> str:
    """What a single mean of the entry is of: ``"mean over 2 detectors that took no part in the attacks"``."""
    part, names = leading(entry.parts)
    of = f" {_WHICH[part]}" if entry.against else ""
    return f"mean over {counted(len(names), 'detector')}{of}"


def curves_of(study: Study) -> dict[str, list[Table]]:
    """Weathers -> a table per parameter that varies there, whose columns are its values.

    Of the first vehicle, undefended, mean over the leading part of the detectors.
    """
    entries = study.of(vehicle=vehicles_of(study)[0], defence=NO_DEFENCE)
    return {
        entry.weathers: [_curve(entry, axis) for axis in AXES if len(entry.results.groups[axis]) > 1]
        for entry in entries
    }


def _curve(entry: Entry, axis: str) -> Table:
    groups, averaged = entry.results.groups[axis], leading(entry.parts)[1]
    rows = []
    for paint in entry.results.paints:
        means = [entry.recorded.mean_of_group(averaged, paint, axis, group) for group in groups]
        cells = [sourced(m, entry, "groups", axis, str(i), "ap", paint) for i, m in enumerate(means)]
        rows.append(Row(paint, tuple(cells)))
    sizes = sorted({group.frames for group in groups})
    frames = f"{sizes[0]}" if len(sizes) == 1 else f"{sizes[0]} to {sizes[-1]}"
    caption = f"{AXIS_TITLES[axis]}: {frames} frame{'' if frames == '1' else 's'} per value."
    columns = tuple(Column(f"{group.value:g}") for group in groups)
    key = f"{axis.partition('_')[0]}-{entry.weathers}"
    return Table(key, AXIS_TITLES[axis], caption, columns, (Block(weathers_title(entry.weathers), tuple(rows)),))
