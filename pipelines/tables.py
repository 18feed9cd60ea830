"""The tables of a report in a terminal, which is narrower than a page."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

from .console import output

if TYPE_CHECKING:
    from rauca_core.report import table as told

# "0.123 [0.012, 0.971]" and a column's frame; the frame of the column of rows' names.
CELL_WIDTH, FRAME_WIDTH = 23, 4


def print_table(table: told.Table) -> None:
    """A table a block, as many columns beside each other as the terminal is wide; the others stand below them."""
    from rauca_core.report.table import AVERAGE, Place

    wide = output()
    names = [f"{c.group}, {c.name}" if c.group == AVERAGE else c.name for c in table.columns]
    for block in table.blocks:
        beside = max(1, (wide.width - max(len(row.name) for row in block.rows) - FRAME_WIDTH) // CELL_WIDTH)
        title = f"{table.caption or table.title} {block.title}".strip()
        for first in range(0, len(names), beside):
            some = slice(first, first + beside)
            shown = Table(table.corner or "paint", *names[some], title=title if first == 0 else None)
            for row in block.rows:
                cells = zip(row.cells[some], table.columns[some], strict=True)
                shown.add_row(row.name, *(_cell(Place(cell, column, 0)) for cell, column in cells))
            wide.print(shown)


def _cell(place: told.Place) -> str:
    return place.shown if place.interval is None else f"{place.shown} [{', '.join(place.interval)}]"
