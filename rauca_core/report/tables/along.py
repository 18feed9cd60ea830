"""AP along one camera or weather parameter, as tables whose columns are the parameter's values."""

from __future__ import annotations

from pathlib import Path
from statistics import mean

from ...study.defended import NO_DEFENCE
from ...study.results import AXES, Group
from ...study.study import Entry, Study
from .model import Block, Cell, Column, Row, Table
from .of_study import source, vehicles_of, weathers_title

AXIS_TITLES = {
    "azimuth_deg": "Azimuth (°), 0 = front",
    "elevation_deg": "Camera elevation (°)",
    "distance_m": "Distance (m)",
    "sun_altitude_deg": "Sun altitude (°)",
    "fog_density": "Fog density (CARLA, 0-100)",
}


def curves_of(study: Study, base: Path) -> dict[str, list[Table]]:
    """Weathers -> a table per parameter that varies there; of the first vehicle, undefended, mean over detectors."""
    entries = study.of(vehicle=vehicles_of(study)[0], defence=NO_DEFENCE)
    return {
        entry.weathers: [_curve(entry, axis, base) for axis in AXES if len(entry.results.groups[axis]) > 1]
        for entry in entries
    }


def _curve(entry: Entry, axis: str, base: Path) -> Table:
    groups = entry.results.groups[axis]
    rows = tuple(
        Row(paint, tuple(_cell(entry, axis, i, group, paint, base) for i, group in enumerate(groups)))
        for paint in entry.results.paints
    )
    sizes = sorted({group.frames for group in groups})
    frames = f"{sizes[0]}" if len(sizes) == 1 else f"{sizes[0]} to {sizes[-1]}"
    caption = f"{AXIS_TITLES[axis]}: {frames} frame{'' if frames == '1' else 's'} per value."
    columns = tuple(Column(f"{group.value:g}") for group in groups)
    title = weathers_title(entry.weathers)
    return Table(
        f"{axis.partition('_')[0]}-{entry.weathers}", AXIS_TITLES[axis], caption, columns, (Block(title, rows),)
    )


def _cell(entry: Entry, axis: str, index: int, group: Group, paint: str, base: Path) -> Cell | None:
    """The mean over detectors; results of version 1 have no interval for it."""
    where = ("groups", axis, str(index))
    if paint in group.mean:
        found = group.mean[paint]
        return Cell(found.ap, found.low, found.high, source(entry, base, *where, "mean", paint))
    values = list(group.ap.get(paint, {}).values())
    return Cell(mean(values), source=source(entry, base, *where, "ap", paint)) if values else None
