"""The report's main figures as files, for a README or a talk."""

from __future__ import annotations

from pathlib import Path

from ..contract import RaucaError
from ..contract.files import write_bytes
from ..study.defended import NO_DEFENCE
from ..study.study import Entry, Study
from .colors import paint_styles
from .grid import FramePicker
from .maps import maps_of
from .plots import curve_svg
from .sections import shown_detectors
from .tables import curves_of
from .tables.of_study import vehicles_of


def save_showcase(study: Study, folder: Path) -> list[Path]:
    """Write ``grid.jpg``, ``table.md``, a ``map-<name>.jpg`` each and, per parameter varied, ``ap-<parameter>.svg``.

    All of the first vehicle, undefended, under the study's first weathers.

    Raises:
        RaucaError: that vehicle was evaluated behind defences only.
    """
    vehicle = vehicles_of(study)[0]
    entry = next(iter(study.of(vehicle=vehicle, defence=NO_DEFENCE)), None)
    if entry is None:
        raise RaucaError(f"{folder}: no pictures; the {vehicle} was evaluated with defences only, add the defence none")
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / "grid.jpg"]
    FramePicker([entry]).grid(shown_detectors([entry])[0]).sheet().save(written[0], quality=88)
    written.append(folder / "table.md")
    write_bytes(written[-1], _markdown(entry).encode())
    for camouflage, jpeg in maps_of([entry]):
        written.append(folder / f"map-{camouflage.name}.jpg")
        write_bytes(written[-1], jpeg)
    styles = paint_styles(entry.results.paints)
    for curve in curves_of(study, folder)[entry.weathers]:
        written.append(folder / f"ap-{curve.key.partition('-')[0]}.svg")
        write_bytes(written[-1], curve_svg(curve, styles).encode())
    return written


def _markdown(entry: Entry) -> str:
    """AP@0.5 of every paint and detector with its 95 % interval."""
    table = entry.results.table
    columns = list(next(iter(table.values())))
    lines = ["| paint | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for paint, row in table.items():
        cells = (f"{row[name].ap:.3f} ({row[name].low:.2f}-{row[name].high:.2f})" for name in columns)
        lines.append(f"| {paint} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"
