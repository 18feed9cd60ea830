"""``rauca report``: the pages and tables of a study that was evaluated before."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rauca_core.contract import RaucaError

from .console import console


def report(
    study: Annotated[Path, typer.Argument(metavar="STUDY", help="folder of a study, such as the demo's")],
    latex: Annotated[bool, typer.Option("--latex", help="write the tables as LaTeX too, to STUDY/report.tex")] = False,
    pictures: Annotated[Path | None, typer.Option(help="save the main figures to this folder too")] = None,
) -> None:
    """Write STUDY/report.html, and its numbers as report.csv and report.json, from what STUDY holds."""
    from rauca_core.report import save_showcase
    from rauca_core.study.study import load_study

    console.print(f"report: {write_study_report(study, latex)}")
    for path in save_showcase(load_study(study), pictures) if pictures else ():
        console.print(f"picture: {path}")


def write_study_report(folder: Path, latex: bool = False) -> Path:
    """Write the report into a study's folder; returns the page.

    Raises:
        RaucaError: the folder holds no study yet, or what it holds is damaged.
    """
    from rauca_core.report import ReportNotes, write_report
    from rauca_core.study.study import FILE_NAME, load_study

    if not (folder / FILE_NAME).is_file():
        raise RaucaError(f"{folder}: has no {FILE_NAME}; run `rauca evaluate` or `rauca demo` first")
    study = load_study(folder)
    return write_report(study, folder / "report.html", ReportNotes(**study.notes), latex)[0]
