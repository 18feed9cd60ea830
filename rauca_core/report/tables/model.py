"""A table of average precisions in the paper's form, before anything decides how it looks."""

from __future__ import annotations

from dataclasses import dataclass

AVERAGE = "Average"
DIGITS = 3  # as the paper prints them
BEST, SECOND = 1, 2


@dataclass(frozen=True)
class Column:
    """A column under the heading ``group``.

    Attributes:
        own: a detector of this project, trained on its synthetic images.
        white_box: a camouflage of the table was optimized against it.
    """

    name: str
    group: str = ""
    own: bool = False
    white_box: bool = False


@dataclass(frozen=True)
class Source:
    """Where a number stands: a file beside the report, and the path of keys inside it."""

    file: str
    keys: tuple[str, ...]


@dataclass(frozen=True)
class Cell:
    """AP@0.5 in [0, 1]; its 95 % interval and source where known; whether the paint was made against the detector."""

    ap: float
    low: float | None = None
    high: float | None = None
    source: Source | None = None
    white_box: bool = False


@dataclass(frozen=True)
class Row:
    """One paint; ``cells`` follows the table's columns, None where nothing was measured."""

    name: str
    cells: tuple[Cell | None, ...]


@dataclass(frozen=True)
class Block:
    """Rows measured under one condition: a set of weathers, a defence."""

    title: str
    rows: tuple[Row, ...]


@dataclass(frozen=True)
class Table:
    """``key`` names the table in files; ``caption`` says what it shows, in one sentence or two."""

    key: str
    title: str
    caption: str
    columns: tuple[Column, ...]
    blocks: tuple[Block, ...]

    @property
    def beside(self) -> bool:
        """Whether its blocks stand side by side, as in the paper; wider tables stack them."""
        return len(self.columns) * len(self.blocks) <= 14

    def groups(self) -> list[tuple[str, int]]:
        """Headings above the columns and how many columns each spans."""
        spans: list[tuple[str, int]] = []
        for column in self.columns:
            if spans and spans[-1][0] == column.group:
                spans[-1] = (column.group, spans[-1][1] + 1)
            else:
                spans.append((column.group, 1))
        return spans


def is_normal(paint: str) -> bool:
    """Whether a row is the vehicle's own paint: others are compared with it, it takes no part in the ranking."""
    return paint.lower() == "normal"


def is_random(paint: str) -> bool:
    """Whether a row is random paint, which every camouflage has to beat."""
    return paint.lower() == "random"


def shown(value: float) -> str:
    """A value as printed."""
    return f"{value:.{DIGITS}f}"


def ranks(block: Block) -> list[list[int]]:
    """``ranks[row][column]``: :data:`BEST` for the lowest AP of a column, :data:`SECOND` for the next, 0 for the rest.

    Values that print alike are alike: all share the rank, and what prints next above them is second. Nothing is ranked
    where only one paint was measured.
    """
    result = [[0] * len(row.cells) for row in block.rows]
    rivals = [index for index, row in enumerate(block.rows) if not is_normal(row.name)]
    for column in range(len(block.rows[0].cells) if block.rows else 0):
        printed = {i: shown(cell.ap) for i in rivals if (cell := block.rows[i].cells[column]) is not None}
        if len(printed) < 2:
            continue
        for rank, value in enumerate(sorted(set(printed.values()))[:SECOND], start=BEST):
            for index in (i for i, text in printed.items() if text == value):
                result[index][column] = rank
    return result
