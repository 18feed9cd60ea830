"""Options of clips, which `rauca evaluate` and `rauca assess` share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

import typer

from rauca_core.contract.clips import MANOEUVRES

from .console import console, output

if TYPE_CHECKING:
    from pathlib import Path

    from rauca_core.study.driven import Drives
    from rauca_core.study.study import Study

ClipNames = Annotated[str | None, typer.Option("--clips", help=f"drive: all, or of {', '.join(MANOEUVRES)}")]
ClipFrames = Annotated[int, typer.Option(min=1, help="frames of each clip")]
Speed = Annotated[float, typer.Option(help="of the camera in clips, m/s")]
FrameRate = Annotated[float, typer.Option(help="of clips, frames a second")]
Shutter = Annotated[float, typer.Option(help="seconds that it is open in clips: motion blur; 0: none")]
Readout = Annotated[
    float, typer.Option(help="seconds from the first row's exposure to the last's in clips: rolling shutter; 0: none")
]
Tracker = Annotated[Literal["bytetrack", "sort"], typer.Option(help="that joins detections of clips")]


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
    from rich.table import Table

    from rauca_core.study.driven import by_detector

    for (vehicle, weathers, defence, detector), rows in by_detector(drives).items():
        title = f"{detector}, {vehicle}, {weathers}, defence {defence}: {rows[0].clips} clips, tracks by "
        columns = ("AP", "lost m", "lost s", "longest gap s", "blind", "breaks", "other track", "HOTA")
        shown = Table("paint", *columns, title=title + drives.tracker)
        for row in rows:
            lost = [
                f"{m.value:.2f}" + ("" if m.low is None else f" [{m.low:.2f}, {m.high:.2f}]")
                for m in (row.lost_m, row.lost_s)
            ]
            blind = "" if row.blind is None else f"{row.blind:.0%}"
            told = (f"{row.gap_s:.2f}", blind, f"{row.breaks}", f"{row.switches}", f"{row.hota:.3f}")
            shown.add_row(row.paint, f"{row.ap:.3f}", *lost, *told)
        output().print(shown)
