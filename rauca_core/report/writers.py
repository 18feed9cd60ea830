"""Tables as CSV, JSON and LaTeX: one writer a form, for every kind of study. As HTML: `templates/parts.html`."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from .table import BEST, SECOND, Cell, Column, Place, Table, interval, laid_out, shown

FORMAT = ("rauca-tables", 2)
RANKS = {BEST: "best", SECOND: "second"}
HEADER = (
    "table", "block", "row", "group", "column", "kind", "own", "white_box", "value", "low", "high", "rank", "file",
    "keys",
)  # fmt: skip


def tables_csv(tables: Sequence[Table]) -> bytes:
    """UTF-8 CSV, a line per value at full precision; empty fields where there is no interval, rank or source."""
    stream = io.StringIO()
    writer = csv.DictWriter(stream, HEADER, lineterminator="\n")
    writer.writeheader()
    for table in tables:
        writer.writerows({**value, "keys": " / ".join(value["keys"])} for value in _values(table))
    return stream.getvalue().encode()


def tables_json(tables: Sequence[Table], command: str, about: Mapping[str, Any]) -> bytes:
    """The same values under the title and caption of their table, with the command and what else is known of a study.

    Args:
        about: more fields, as JSON.
    """
    name, version = FORMAT
    listed = [
        {"key": table.key, "title": table.title, "caption": table.caption, "values": list(_values(table))}
        for table in tables
    ]
    value = {"format": name, "version": version, "command": command, **about, "tables": listed}
    return (json.dumps(value, indent=1, allow_nan=False) + "\n").encode()


def _values(table: Table) -> Iterator[dict[str, Any]]:
    """Every value of a table with what it belongs to."""
    for block in table.blocks:
        for row, ranks in zip(block.rows, table.ranks(block), strict=True):
            for column, cell, rank in zip(table.columns, row.cells, ranks, strict=True):
                if cell is not None:
                    where = {"table": table.key, "block": block.title, "row": row.name}
                    yield {**where, **_value(column, cell), "rank": RANKS.get(rank, ""), **_source(cell)}


def _value(column: Column, cell: Cell) -> dict[str, Any]:
    told = {"group": column.group, "column": column.name, "kind": column.kind, "own": column.own}
    return {**told, "white_box": cell.white_box, "value": cell.value, "low": cell.low, "high": cell.high}


def _source(cell: Cell) -> dict[str, Any]:
    return {"file": cell.source.file if cell.source else "", "keys": list(cell.source.keys) if cell.source else []}


_PREAMBLE = r"""\documentclass{article}
\usepackage[T1]{fontenc}
\usepackage[utf8]{inputenc}
\usepackage[margin=2cm]{geometry}
\usepackage{booktabs,graphicx}
\begin{document}
"""
_SPECIAL = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}",
    ">": r"\textgreater{}", "|": r"\textbar{}", '"': r"\textquotedbl{}", "“": "``", "”": "''", "–": "--", "’": "'",
    **{character: f"\\{character}" for character in "&%$#_{}"},
    **{character: f"{{{character}}}" for character in "[]*"},  # after a line's end they would be its options
}  # fmt: skip
_WIDE = 8  # columns that fit a page at full size


def escape_latex(text: str) -> str:
    """Any text as LaTeX; characters that T1 fonts lack become question marks."""
    return "".join(_SPECIAL.get(c) or (c if " " <= c < "\x7f" or "\xc0" <= c <= "\u017f" else "?") for c in text)


def tables_latex(tables: Sequence[Table], command: str) -> bytes:
    """A document that compiles as it stands, a float per table, which can be taken out of it (booktabs, graphicx).

    Best in bold, second underlined, intervals in small type below.
    """
    remark = f"% Written by: {' '.join(command.split())}\n"
    return (remark + _PREAMBLE + "\n".join(map(_float, tables)) + "\\end{document}\n").encode()


def _float(table: Table) -> str:
    tabular = _tabular(table)
    if len(table.columns) * (len(table.blocks) if table.beside else 1) > _WIDE:
        tabular = f"\\resizebox{{\\linewidth}}{{!}}{{%\n{tabular}}}\n"
    label = "".join(c if c.isascii() and c.isalnum() else "-" for c in table.key)
    caption = " ".join(filter(None, (escape_latex(table.caption or table.title), *_notes(table))))
    return (
        f"\\begin{{table}}[p]\n\\centering\n\\caption{{{caption}}}\n\\label{{tab:{label}}}\n\\small\n"
        f"{tabular}\\end{{table}}\n"
    )


def _notes(table: Table) -> Iterator[str]:
    if table.ranked:
        yield r"Lowest in bold, second underlined."
    if any(cell and cell.low is not None for block in table.blocks for row in block.rows for cell in row.cells):
        yield r"Below each value: its 95\,\% interval."
    if any(column.white_box for column in table.columns):
        yield r"\textsuperscript{w}\,White-box."
    if any(column.own for column in table.columns):
        yield r"\textsuperscript{s}\,Our own, trained on synthetic images."


def _tabular(table: Table) -> str:
    layout, width = laid_out(table), len(table.columns)
    letters = ["l" if column.textual else "r" for column in layout.columns]
    aligned = "|".join("".join(letters[start : start + width]) for start in range(0, len(letters), width))
    names = "".join(f" & {escape_latex(column.name)}{_marks(column)}" for column in layout.columns)
    head = _spanning(layout.blocks) + _spanning(layout.groups) + f"{escape_latex(table.corner)}{names} \\\\\n"
    strips = []
    for title, lines in layout.strips:
        spanned = f"\\multicolumn{{{width + 1}}}{{l}}{{\\textit{{{escape_latex(title)}}}}} \\\\\n" if title else ""
        strips.append(spanned + "".join(_line(line.name, line.places) for line in lines))
    body = "\\midrule\n".join(strips)
    return f"\\begin{{tabular}}{{l{aligned}}}\n\\toprule\n{head}\\midrule\n{body}\\bottomrule\n\\end{{tabular}}\n"


def _marks(column: Column) -> str:
    letters = "w" * column.white_box + "s" * column.own
    return f"\\textsuperscript{{{letters}}}" if letters else ""


def _spanning(spans: Sequence[tuple[str, int]]) -> str:
    """Headings that span columns, with a rule under each."""
    cells, rules, at = "", "", 2
    for title, width in spans:
        cells += f" & \\multicolumn{{{width}}}{{c}}{{{escape_latex(title)}}}"
        rules += f"\\cmidrule(lr){{{at}-{at + width - 1}}}" if title else ""
        at += width
    return f"{cells} \\\\\n{rules}\n" if spans else ""


def _line(name: str, places: Sequence[Place]) -> str:
    """A row's values and, where there are any, their intervals in a line below."""
    values, ends = [], []
    for place in places:
        value, found = escape_latex(shown(place.cell, place.column)), interval(place.cell, place.column)
        values.append({BEST: f"\\textbf{{{value}}}", SECOND: f"\\underline{{{value}}}"}.get(place.rank, value))
        ends.append(f"{{\\tiny {escape_latex('–'.join(found))}}}" if found else "")
    lines = f"{escape_latex(name)} & {' & '.join(values)} \\\\\n"
    return lines + (f" & {' & '.join(ends)} \\\\\n" if any(ends) else "")
