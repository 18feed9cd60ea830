"""``rauca demo``: the main job on one vehicle, and its report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import rauca_core as rauca

from .console import command_line, console
from .options import Blender, Device, PaintMask, PaintMaterial, RenderDevice, Slurm, means_of


def demo(
    out: Annotated[Path, typer.Option(help="folder of the run; run again to go on")] = Path("runs/demo"),
    vehicle: Annotated[str, typer.Option(help="shipped vehicle's name, or an .obj, .glb or .blend")] = "sedan",
    paint_mask: PaintMask = None,
    paint_material: PaintMaterial = None,
    device: Device = "cpu",
    slurm: Slurm = None,
    blender: Blender = None,
    render_device: RenderDevice = "cpu",
) -> None:
    """The main job: data set, camouflage, re-rendered views, AP@0.5, report. About ten minutes on two cores."""
    from rauca_core.study.demo import demo as run

    with means_of(device, slurm, blender, render_device) as means:
        run(out, vehicle, paint_mask=paint_mask, paint_material=paint_material, command=command_line(), **means)
    console.print(f"report: {rauca.Study.load(out).report(out / 'report.html')}")
