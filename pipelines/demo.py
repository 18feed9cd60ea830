"""``rauca demo``: the main job on one vehicle, and its report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import rauca_core as rauca

from .console import command_line, console, progress_bars
from .options import Blender, Device, RenderDevice, Slurm, executor_of


def demo(
    out: Annotated[Path, typer.Option(help="folder of the run; run again to resume")] = Path("runs/demo"),
    vehicle: Annotated[str, typer.Option(help="shipped vehicle's name, or an .obj, .glb or .blend")] = "sedan",
    paint_mask: Annotated[Path | None, typer.Option(help="grey PNG, white where the camouflage may go")] = None,
    paint_material: Annotated[str | None, typer.Option(help="name of the material to camouflage")] = None,
    device: Device = "cpu",
    slurm: Slurm = None,
    blender: Blender = None,
    render_device: RenderDevice = "cpu",
) -> None:
    """The main job: data set, camouflage, re-rendered views, AP@0.5, report. About half an hour on two cores."""
    from rauca_core.study.demo import demo as run

    with progress_bars() as on_progress:
        run(
            out,
            vehicle,
            paint_mask=paint_mask,
            paint_material=paint_material,
            device=device,
            blender=blender,
            render_device=render_device,
            executor=executor_of(slurm),
            on_progress=on_progress,
            command=command_line(),
        )
    console.print(f"report: {rauca.Study.load(out).report(out / 'report.html')}")
