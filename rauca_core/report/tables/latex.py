"""Tables as a LaTeX document that compiles as it stands; each table can be taken out of it (booktabs, graphicx)."""

from __future__ import annotations

from collections.abc import Sequence

from .model import BEST, SECOND, Block, Cell, Column, Table, ranks, shown

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


def escape(text: str) -> str:
    """Any text as LaTeX; characters that T1 fonts lack become question marks."""
    return "".join(_SPECIAL.get(c) or (c if " " <= c < "\x7f" or "\xc0" <= c <= "\u017f" else "?") for c in text)


def tables_latex(tables: Sequence[Table], command: str) -> bytes:
    """A document with a float per table; best in bold, second underlined, intervals in small type below."""
    remark = f"% Written by: {' '.join(command.split())}\n"
    return (remark + _PREAMBLE + "\n".join(map(_float, tables)) + "\\end{document}\n").encode()


def _float(table: Table) -> str:
    tabular = _beside(table) if table.beside else _stacked(table)
    width = len(table.columns) * (len(table.blocks) if table.beside else 1)
    if width > _WIDE:
        tabular = f"\\resizebox{{\\linewidth}}{{!}}{{%\n{tabular}}}\n"
    caption = f"{escape(table.caption)} {_notes(table)}".strip()
    return (
        f"\\begin{{table}}[p]\n\\centering\n\\caption{{{caption}}}\n\\label{{tab:{_label(table.key)}}}\n\\small\n"
        f"{tabular}\\end{{table}}\n"
    )


def _label(key: str) -> str:
    return "".join(c if c.isascii() and c.isalnum() else "-" for c in key)


def _notes(table: Table) -> str:
    notes = [r"Lowest in bold, second underlined."]
    if any(cell and cell.low is not None for block in table.blocks for row in block.rows for cell in row.cells):
        notes.append(r"Below each value: its 95\,\% interval.")
    if any(column.white_box for column in table.columns):
        notes.append(r"\textsuperscript{w}\,White-box.")
    if any(column.own for column in table.columns):
        notes.append(r"\textsuperscript{s}\,Our own, trained on synthetic images.")
    return " ".join(notes)


def _beside(table: Table) -> str:
    """Blocks side by side, as the paper sets them."""
    width, blocks = len(table.columns), table.blocks
    names = list(dict.fromkeys(row.name for block in blocks for row in block.rows))
    head = _heads(table, len(blocks))
    if any(block.title for block in blocks):
        spans = [(block.title, width) for block in blocks]
        head = _spanning(spans) + head
    body = "".join(_line(name, [_row_of(block, name, width) for block in blocks]) for name in names)
    return _tabular("|".join(["r" * width] * len(blocks)), head, body)


def _stacked(table: Table) -> str:
    """Blocks below each other, each under its title."""
    width = len(table.columns)
    parts = []
    for block in table.blocks:
        title = f"\\multicolumn{{{width + 1}}}{{l}}{{\\textit{{{escape(block.title)}}}}} \\\\\n" if block.title else ""
        parts.append(title + "".join(_line(row.name, [_row_of(block, row.name, width)]) for row in block.rows))
    return _tabular("r" * width, _heads(table, 1), "\\midrule\n".join(parts))


def _tabular(columns: str, head: str, body: str) -> str:
    return f"\\begin{{tabular}}{{l{columns}}}\n\\toprule\n{head}\\midrule\n{body}\\bottomrule\n\\end{{tabular}}\n"


def _heads(table: Table, times: int) -> str:
    marked = "".join(f" & {escape(column.name)}{_marks(column)}" for column in table.columns)
    return _spanning(table.groups() * times) + marked * times + " \\\\\n"


def _marks(column: Column) -> str:
    letters = "w" * column.white_box + "s" * column.own
    return f"\\textsuperscript{{{letters}}}" if letters else ""


def _spanning(spans: Sequence[tuple[str, int]]) -> str:
    """Headings that span columns, with a rule under each."""
    if not any(title for title, _ in spans):
        return ""
    cells, rules, at = "", "", 2
    for title, width in spans:
        cells += f" & \\multicolumn{{{width}}}{{c}}{{{escape(title)}}}"
        rules += f"\\cmidrule(lr){{{at}-{at + width - 1}}}" if title else ""
        at += width
    return f"{cells} \\\\\n{rules}\n"


def _row_of(block: Block, name: str, width: int) -> tuple[tuple[Cell | None, int], ...]:
    """The cells of a paint with their ranks; empty ones when the block lacks it."""
    for row, places in zip(block.rows, ranks(block), strict=True):
        if row.name == name:
            return tuple(zip(row.cells, places, strict=True))
    return ((None, 0),) * width


def _line(name: str, blocks: Sequence[tuple[tuple[Cell | None, int], ...]]) -> str:
    cells = [cell for block in blocks for cell in block]
    line = f"{escape(name)} & " + " & ".join(_value(cell, rank) for cell, rank in cells) + " \\\\\n"
    if all(cell is None or cell.low is None for cell, _ in cells):
        return line
    return line + " & " + " & ".join(_interval(cell) for cell, _ in cells) + " \\\\\n"


def _value(cell: Cell | None, rank: int) -> str:
    if cell is None:
        return "--"
    value = shown(cell.ap)
    return {BEST: f"\\textbf{{{value}}}", SECOND: f"\\underline{{{value}}}"}.get(rank, value)


def _interval(cell: Cell | None) -> str:
    if cell is None or cell.low is None or cell.high is None:
        return ""
    return f"{{\\tiny {shown(cell.low)}--{shown(cell.high)}}}"
