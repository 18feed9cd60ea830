"""``rauca compare``: finished studies to one table of rows, seeds and verdicts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .console import command_line, console, output
from .options import split_names
from .tables import print_table

Studies = Annotated[
    list[Path], typer.Argument(metavar="STUDY...", help="folders of `rauca evaluate`, same camouflages")
]
Out = Annotated[Path, typer.Option(help="page; its numbers are written beside it")]
Rows = Annotated[str, typer.Option(help="rows that take part, comma separated; all if left out")]
Lowest = Annotated[str, typer.Option(help="row that is claimed to be below all others; decided with 5 seeds and more")]


def compare(studies: Studies, out: Out = Path("compared.html"), rows: Rows = "", lowest: Lowest = "") -> None:
    """Hold camouflages of finished studies against each other; `NAME s0`, `NAME s1` ... are seeds of one row."""
    from rauca_core.report import Study, write_compared
    from rauca_core.report.compared_page import table_by_part
    from rauca_core.study.compare import compare as run

    names = [folder.name for folder in studies]
    alike = len(set(names)) < len(names)
    found = run({str(folder) if alike else folder.name: Study.load(folder) for folder in studies}, split_names([rows]))
    verdicts = found.verdicts(lowest) if lowest else []
    pages = write_compared(found, out, command_line(), verdicts)
    print_table(table_by_part(found))
    titles = {row: row for row in found.rows}
    for verdict in verdicts:
        output().print(verdict.sentence(titles), highlight=False, soft_wrap=True)
    console.print(f"comparison: {pages[0]}", highlight=False, soft_wrap=True)
