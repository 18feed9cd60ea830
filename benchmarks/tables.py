"""What a benchmark found, as tables: in the terminal or as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.table import Table

from pipelines.console import output

Rows = list[tuple[str, ...]]
Grid = tuple[str, tuple[str, ...], Sequence[tuple[str, ...]]]  # title, headers, rows


def print_tables(grids: Iterable[Grid], width: int) -> None:
    """Print tables at least ``width`` characters wide: a log has no terminal's width."""
    console = output(width)
    for title, headers, rows in grids:
        table = Table(*headers, title=title)
        for row in rows:
            table.add_row(*row)
        console.print(table)


def markdown_tables(grids: Iterable[Grid], heading: str = "### {}") -> str:
    """Tables as Markdown, each under its title written as ``heading`` says."""
    return "\n".join(_markdown(heading.format(title), headers, rows) for title, headers, rows in grids)


def _markdown(heading: str, headers: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [heading, "", "| " + " | ".join(headers) + " |", "|---" * len(headers) + "|"]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"
