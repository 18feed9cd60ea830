"""``rauca report``: the pages and tables of a study that was evaluated before."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import rauca_core as rauca

from .console import console


def report(
    study: Annotated[Path, typer.Argument(metavar="STUDY", help="folder of a study, such as the demo's")],
    latex: Annotated[bool, typer.Option("--latex", help="write the tables as LaTeX too, to STUDY/report.tex")] = False,
    pictures: Annotated[Path | None, typer.Option(help="save the main figures to this folder too")] = None,
) -> None:
    """Write STUDY/report.html, and its numbers as report.csv and report.json, from what STUDY holds."""
    from rauca_core.report import save_showcase

    found = rauca.Study.load(study)
    console.print(f"report: {found.report(study / 'report.html', latex)}")
    for path in save_showcase(found, pictures) if pictures else ():
        console.print(f"picture: {path}")
