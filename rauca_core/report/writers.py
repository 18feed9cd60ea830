"""Tables as CSV, JSON and LaTeX: one writer a form, for every kind of study. As HTML: `templates/parts.html`."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from .table import BEST, SECOND, Layout, Source, Table, laid_out

FORMAT = ("rauca-tables", 2)
TEMPLATES = FileSystemLoader(Path(__file__).with_name("templates"), encoding="utf-8")
RANKS = {BEST: "best", SECOND: "second"}
HEADER = (
    "table", "block", "row", "group", "column", "kind", "own", "white_box", "value", "low", "high", "rank", "file",
    "keys",
)  # fmt: skip


def tables_csv(tables: Sequence[Table], base: Path) -> bytes:
    """UTF-8 CSV, a line per value at full precision; empty fields where there is no interval, rank or source.

    Args:
        base: the folder that sources are told relative to.
    """
    stream = io.StringIO()
    writer = csv.DictWriter(stream, HEADER, lineterminator="\n")
    writer.writeheader()
    for table in tables:
        writer.writerows({**value, "keys": " / ".join(value["keys"])} for value in _values(table, base))
    return stream.getvalue().encode()


def tables_json(tables: Sequence[Table], command: str, about: Mapping[str, Any], base: Path) -> bytes:
    """The same values under the title and caption of their table, with the command and what else is known of a study.

    Args:
        about: more fields, as JSON.
        base: as of :func:`tables_csv`.
    """
    name, version = FORMAT
    listed = [
        {"key": table.key, "title": table.title, "caption": table.caption, "values": list(_values(table, base))}
        for table in tables
    ]
    value = {"format": name, "version": version, "command": command, **about, "tables": listed}
    return (json.dumps(value, indent=1, allow_nan=False) + "\n").encode()


def _values(table: Table, base: Path) -> Iterator[dict[str, Any]]:
    """Every value of a table with what it belongs to."""
    for block in table.blocks:
        for row, ranks in zip(block.rows, table.ranks(block), strict=True):
            for column, cell, rank in zip(table.columns, row.cells, ranks, strict=True):
                if cell is not None:
                    source = cell.source or Source("", ())
                    yield {
                        "table": table.key, "block": block.title, "row": row.name, "group": column.group,
                        "column": column.name, "kind": column.kind, "own": column.own, "white_box": cell.white_box,
                        "value": cell.value, "low": cell.low, "high": cell.high, "rank": RANKS.get(rank, ""),
                        "file": source.told(base), "keys": list(source.keys),
                    }  # fmt: skip


_SPECIAL = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}",
    ">": r"\textgreater{}", "|": r"\textbar{}", '"': r"\textquotedbl{}", "“": "``", "”": "''", "–": "--", "’": "'",
    **{character: f"\\{character}" for character in "&%$#_{}"},
    **{character: f"{{{character}}}" for character in "[]*"},  # after a line's end they would be its options
}  # fmt: skip


def escape_latex(text: str) -> str:
    """Any text as LaTeX; characters that T1 fonts lack become question marks."""
    return "".join(_SPECIAL.get(c) or (c if " " <= c < "\x7f" or "\xc0" <= c <= "\u017f" else "?") for c in text)


def tables_latex(tables: Sequence[Table], command: str) -> bytes:
    """A document that compiles as it stands, a float per table, which can be taken out of it (booktabs, graphicx).

    Best in bold, second underlined, intervals in small type below.
    """
    found = Environment(
        "<%", "%>", "<<", ">>", "<#", "#>", loader=TEMPLATES, finalize=_finished, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    found.filters |= {
        "aligned": _aligned,
        "label": lambda key: "".join(c if c.isascii() and c.isalnum() else "-" for c in key),
        "laid_out": laid_out,
        "one_line": lambda text: _Plain(" ".join(text.split())),
    }
    return found.get_template("tables.tex").render(tables=tables, command=command).encode()


class _Plain(str):
    """Text that a LaTeX document takes as it is."""


def _finished(value: object) -> object:
    """Every value of the template, escaped."""
    return value if isinstance(value, _Plain) else escape_latex(str(value))


def _aligned(layout: Layout) -> _Plain:
    letters = ["l" if column.textual else "r" for column in layout.columns]
    width = len(letters) // layout.times
    return _Plain("|".join("".join(letters[start : start + width]) for start in range(0, len(letters), width)))
