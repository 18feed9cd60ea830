"""The one table model: what a table says, before anything decides how it looks and in which file it lies."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Kind = Literal["score", "change", "share", "loss", "number", "count", "chance", "text", "code"]

AVERAGE = "Average"
BEST, SECOND = 1, 2
_FORMS: dict[Kind, str] = {
    "score": ".3f", "change": "+.3f", "share": ".0%", "loss": ".3f", "chance": ".3f", "number": ".1f", "count": ".0f",
}  # fmt: skip
_WIDEST = 14  # columns that still stand side by side


@dataclass(frozen=True)
class Column:
    """A column under the heading ``group``.

    Attributes:
        own: a detector of this project, trained on its synthetic images.
        white_box: a camouflage of the table was optimized against it.
        kind: ``score``, AP@0.5 from 0 to 1; ``change``, the difference of two; ``share``, where 1 is the whole;
            ``loss``; ``chance``, a p; ``number``, of any size; ``count``, a whole one; ``text``, and
            ``code`` for text of fixed width.
    """

    name: str
    group: str = ""
    own: bool = False
    white_box: bool = False
    kind: Kind = "score"

    @property
    def textual(self) -> bool:
        return self.kind in ("text", "code")


@dataclass(frozen=True)
class Source:
    """Where a number stands: a file, or the name of what was printed, and the path of keys inside it."""

    file: Path | str
    keys: tuple[str, ...]

    def told(self, base: Path) -> str:
        """The file as a page in the folder ``base`` names it."""
        return self.file if isinstance(self.file, str) else Path(os.path.relpath(self.file, base)).as_posix()


@dataclass(frozen=True)
class Cell:
    """A value with what is known about it.

    Attributes:
        low, high: its 95 % interval.
        source: where it stands, or the numbers that it is computed from.
        white_box: whether the row's paint was made against the column's detector.
        link: an address relative to the page that the value leads to.
    """

    value: float | str
    low: float | None = None
    high: float | None = None
    source: Source | None = None
    white_box: bool = False
    link: str = ""


@dataclass(frozen=True)
class Row:
    """``cells`` follows the table's columns, None where nothing is known; ``anchor`` is what links on a page name."""

    name: str
    cells: tuple[Cell | None, ...]
    anchor: str = ""


@dataclass(frozen=True)
class Block:
    """Rows measured under one condition: a set of weathers, a defence."""

    title: str
    rows: tuple[Row, ...]


@dataclass(frozen=True)
class Table:
    """A frame of typed columns.

    Attributes:
        key: names the table in files.
        caption: what it shows, in one sentence or two.
        ranked: whether rows compete: the lowest score of a column is best, unless it is the vehicle's normal paint's.
        corner: the heading of the rows' names.
    """

    key: str
    title: str
    caption: str
    columns: tuple[Column, ...]
    blocks: tuple[Block, ...]
    ranked: bool = True
    corner: str = ""

    @property
    def beside(self) -> bool:
        """Whether its blocks stand side by side, as in the paper; wider tables stack them."""
        return len(self.columns) * len(self.blocks) <= _WIDEST

    @property
    def has_intervals(self) -> bool:
        cells = (cell for block in self.blocks for row in block.rows for cell in row.cells)
        return any(cell is not None and cell.low is not None for cell in cells)

    def groups(self) -> list[tuple[str, int]]:
        """Headings above the columns and how many columns each spans."""
        spans: list[tuple[str, int]] = []
        for column in self.columns:
            if spans and spans[-1][0] == column.group:
                spans[-1] = (column.group, spans[-1][1] + 1)
            else:
                spans.append((column.group, 1))
        return spans

    def ranks(self, block: Block) -> list[list[int]]:
        """``[row][column]``: :data:`BEST` for the lowest score of a column, :data:`SECOND` for the next, 0 for others.

        Values that print alike are alike: all share the rank, and what prints next above them is second. Nothing is
        ranked where only one paint was measured.
        """
        result = [[0] * len(self.columns) for _ in block.rows]
        rivals = [index for index, row in enumerate(block.rows) if self.ranked and not is_normal(row.name)]
        for place, column in enumerate(self.columns):
            printed = {i: shown(cell, column) for i in rivals if (cell := block.rows[i].cells[place]) is not None}
            if column.kind != "score" or len(printed) < 2:
                continue
            for rank, value in enumerate(sorted(set(printed.values()))[:SECOND], start=BEST):
                for index in (i for i, text in printed.items() if text == value):
                    result[index][place] = rank
        return result


def listing(key: str, corner: str, columns: tuple[Column, ...], rows: tuple[Row, ...], title: str = "") -> Table:
    """A table of one block whose rows do not compete."""
    return Table(key, title, "", columns, (Block("", rows),), ranked=False, corner=corner)


def is_normal(paint: str) -> bool:
    """Whether a row is the vehicle's own paint: others are compared with it, it takes no part in the ranking."""
    return paint.lower() == "normal"


def is_random(paint: str) -> bool:
    """Whether a row is random paint, which every camouflage has to beat."""
    return paint.lower() == "random"


def printed(value: float, kind: Kind = "score") -> str:
    """A number as it is printed: average precisions with three digits, as the paper prints them."""
    return format(value, _FORMS[kind])


def shown(cell: Cell, column: Column) -> str:
    """A cell's value as it is printed."""
    return cell.value if isinstance(cell.value, str) else printed(cell.value, column.kind)


@dataclass(frozen=True)
class Place:
    """A cell where it stands."""

    cell: Cell | None
    column: Column
    rank: int

    @property
    def shown(self) -> str:
        """The value as it is printed."""
        return "–" if self.cell is None else shown(self.cell, self.column)

    @property
    def interval(self) -> tuple[str, str] | None:
        """The ends of the value's 95 % interval as they are printed; None where it has none."""
        cell, kind = self.cell, self.column.kind
        if cell is None or cell.low is None or cell.high is None:
            return None
        return printed(cell.low, kind), printed(cell.high, kind)


@dataclass(frozen=True)
class Line:
    """A row across all blocks that stand side by side."""

    name: str
    anchor: str
    places: tuple[Place, ...]


@dataclass(frozen=True)
class Layout:
    """A table laid out for a page, whatever the page is written in.

    Attributes:
        blocks, groups: headings above the columns, with how many each spans; empty where there are none.
        columns, opening: across all blocks that stand side by side, and which of them open a group.
        times: how many blocks stand side by side.
        strips: rows below each other, each strip under its title.
    """

    blocks: list[tuple[str, int]]
    groups: list[tuple[str, int]]
    columns: tuple[Column, ...]
    opening: list[bool]
    times: int
    strips: list[tuple[str, list[Line]]]


def laid_out(table: Table) -> Layout:
    """Blocks side by side where they fit, else below each other."""
    blocks = table.blocks
    times = len(blocks) if table.beside else 1
    groups = table.groups() * times if any(title for title, _ in table.groups()) else []
    titles = [(block.title, len(table.columns)) for block in blocks if table.beside]
    strips = [("" if table.beside else block.title, _lines(table, block)) for block in blocks]
    if times > 1:
        strips = [("", _joined(table, [lines for _, lines in strips]))]
    above = titles if any(title for title, _ in titles) else []
    opening = [number == 0 for _, width in table.groups() for number in range(width)]
    return Layout(above, groups, table.columns * times, opening * times, times, strips)


def _joined(table: Table, blocks: list[list[Line]]) -> list[Line]:
    """Rows of the same name as one, with empty cells where a block lacks it."""
    found = [{line.name: line.places for line in lines} for lines in blocks]
    missing = tuple(Place(None, column, 0) for column in table.columns)
    return [
        Line(name, "", tuple(place for places in found for place in places.get(name, missing)))
        for name in dict.fromkeys(name for places in found for name in places)
    ]


def _lines(table: Table, block: Block) -> list[Line]:
    ranked = zip(block.rows, table.ranks(block), strict=True)
    return [Line(row.name, row.anchor, tuple(map(Place, row.cells, table.columns, ranks))) for row, ranks in ranked]
