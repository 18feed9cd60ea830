"""Tables as CSV, one line per number, and as JSON; at full precision."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from .model import BEST, SECOND, Table, ranks

FORMAT = ("rauca-tables", 1)
RANKS = {BEST: "best", SECOND: "second"}
HEADER = (
    "table", "block", "row", "group", "column", "own", "white_box", "ap", "low", "high", "rank", "file", "keys",
)  # fmt: skip


def tables_csv(tables: Sequence[Table]) -> bytes:
    """UTF-8 CSV with a header; empty fields where there is no interval, rank or source."""
    stream = io.StringIO()
    writer = csv.DictWriter(stream, HEADER, lineterminator="\n")
    writer.writeheader()
    for table in tables:
        writer.writerows({**line, "keys": " / ".join(line["keys"])} for line in _lines(table))
    return stream.getvalue().encode()


def tables_json(tables: Sequence[Table], command: str) -> bytes:
    """The same lines, under the title and caption of their table, with the command that made the study."""
    name, version = FORMAT
    shown = [
        {"key": table.key, "title": table.title, "caption": table.caption, "values": list(_lines(table))}
        for table in tables
    ]
    value = {"format": name, "version": version, "command": command, "tables": shown}
    return (json.dumps(value, indent=1, allow_nan=False) + "\n").encode()


def _lines(table: Table) -> Iterator[dict[str, Any]]:
    """Every number of a table with what it belongs to."""
    for block in table.blocks:
        for row, places in zip(block.rows, ranks(block), strict=True):
            for column, cell, place in zip(table.columns, row.cells, places, strict=True):
                if cell is None:
                    continue
                where = {"table": table.key, "block": block.title, "row": row.name}
                number = {name: value for name, value in asdict(cell).items() if name in ("ap", "low", "high")}
                yield {
                    **where, "group": column.group, "column": column.name, "own": column.own,
                    "white_box": cell.white_box, **number, "rank": RANKS.get(place, ""),
                    "file": cell.source.file if cell.source else "",
                    "keys": list(cell.source.keys) if cell.source else [],
                }  # fmt: skip
