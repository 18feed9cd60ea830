"""Options of clips, which `rauca evaluate` and `rauca assess` share."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from rauca_core.contract.clips import MANOEUVRES

from .console import console, output
from .tables import print_table

if TYPE_CHECKING:
    from pathlib import Path

    from rauca_core.study.driven import Drives
    from rauca_core.study.study import Study

clip_option = partial(typer.Option, rich_help_panel="Clips")
ClipNames = Annotated[str | None, clip_option("--clips", help=f"drive: all, or of {', '.join(MANOEUVRES)}")]
ClipFrames = Annotated[int, clip_option(min=1, help="frames of each clip")]
Speed = Annotated[float, clip_option(help="of the camera in clips, m/s")]
FrameRate = Annotated[float, clip_option(help="of clips, frames a second")]
Shutter = Annotated[float, clip_option(help="seconds that it is open in clips: motion blur; 0: none")]
Readout = Annotated[
    float, clip_option(help="seconds from the first row's exposure to the last's in clips: rolling shutter; 0: none")
]
Tracker = Annotated[Literal["bytetrack", "sort"], clip_option(help="that joins detections of clips")]


def write_drives(study: Study, out: Path, tracker: str) -> Drives:
    """Read the clips of a study in ``out``, and write their figures and page there."""
    from rauca_core.report import write_clips
    from rauca_core.study.driven import measure_drives, save_drives

    drives = measure_drives(study, tracker)
    save_drives(out, drives)
    console.print(f"page: {write_clips(study, drives, out / 'clips.html')[0]}", highlight=False, soft_wrap=True)
    return drives


def show_drives(drives: Drives) -> None:
    """Print what clips say of warning, a table per vehicle, weathers, defence and detector."""
    from rauca_core.report.clips_page import clip_tables
    from rauca_core.report.table import Source
    from rauca_core.study.driven import FILE_NAME

    for table in clip_tables(drives, Source(FILE_NAME, ("rows",))):
        print_table(table)
    clips = " or ".join(map(str, sorted({row.clips for row in drives.rows})))
    output().print(f"{clips} clips, tracks by {drives.tracker}; in brackets: 95 % interval over clips")
