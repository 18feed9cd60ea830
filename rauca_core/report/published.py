"""Tables that others printed, from ``assets/paper``: the paper's own, and another laboratory's of the same methods."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import mean
from typing import Any

from ..contract.assets import assets_folder
from ..contract.schema import Fields, read_json
from .table import AVERAGE, Block, Cell, Column, Row, Source, Table, printed

FORMAT = ("rauca-paper-tables", 1)
ROUNDING = 0.0015  # of six values and of their mean, each printed to 0.001


@dataclass(frozen=True)
class PaperTable:
    """A published table. ``beside`` is the kind of our table that it compares with: detectors, defences, vehicles."""

    number: int
    beside: str
    table: Table

    @property
    def odd_averages(self) -> list[str]:
        """Printed averages that are not the mean of their row, each in a few words."""
        odd: list[str] = []
        if self.table.columns[-1].name != AVERAGE:
            return odd
        for block in self.table.blocks:
            for row in block.rows:
                *values, told = (float(cell.value) for cell in row.cells if cell is not None)
                if abs(mean(values) - told) > ROUNDING:
                    where = ", ".join(filter(None, (row.name, block.title.lower())))
                    odd.append(f"{where}: {printed(told)} printed, {printed(mean(values))} computed")
        return odd


def published_means() -> dict[str, dict[str, float]]:
    """Who printed it -> method, as `rauca methods` spells it -> AP@0.5, mean over detectors and weathers.

    The means are computed from the printed values of the detectors: some printed averages are not theirs.
    """
    return {
        "the paper, Table 3": _means(next(one for one in paper_tables() if one.beside == "detectors")),
        "R-PGA, arXiv 2603.26067": _means(paper_tables("r-pga.json")[0]),
    }


def _means(paper: PaperTable) -> dict[str, float]:
    printed_of = [i for i, column in enumerate(paper.table.columns) if column.name != AVERAGE]
    values: dict[str, list[float]] = {}
    for block in paper.table.blocks:
        for row in block.rows:
            cells = (row.cells[i] for i in printed_of)
            values.setdefault(row.name.lower(), []).extend(float(cell.value) for cell in cells if cell is not None)
    return {method: mean(some) for method, some in values.items()}


def paper_tables(file: str = "tables.json") -> list[PaperTable]:
    """In the order of a file of ``assets/paper``; raises :class:`RaucaError` when it is missing or damaged."""
    path = assets_folder() / "paper" / file
    fields = read_json(path)
    fields.format(*FORMAT)
    paper, rows = fields.text("paper"), fields.items("tables")
    fields.done()
    return [_paper_table(Fields(row, f"{path}: tables[{i}]"), paper) for i, row in enumerate(rows)]


def _paper_table(fields: Fields, paper: str) -> PaperTable:
    number, label, caption = fields.integer("number"), fields.text("label"), fields.text("caption")
    columns = tuple(Column(name, group["group"]) for group in fields.items("columns") for name in group["names"])
    blocks = tuple(_block(block, label) for block in fields.items("blocks"))
    beside = fields.text("beside")
    fields.done()
    table = Table(f"paper-{number}", f"The paper's Table {number}", f"{caption}. From “{paper}”.", columns, blocks)
    return PaperTable(number, beside, table)


def _block(block: dict[str, Any], label: str) -> Block:
    def cell(paint: str, value: float) -> Cell:
        return Cell(value, source=Source(f"the paper, {label}", (block["title"], paint)))

    rows = (Row(paint, tuple(cell(paint, v) for v in values)) for paint, values in block["rows"].items())
    return Block(block["title"], tuple(rows))
