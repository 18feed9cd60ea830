"""``rauca ablate``: variants of one optimization, all measured on the same held-out views."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .console import command_line, console
from .options import Blender, Device, RenderDevice, Slurm, Threads, means_of, resized, split_names


def ablate(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help="baselines, renderer, dataset, beta, augmentation, environment, views, limit, sampling or paint",
        ),
    ],
    out: Annotated[Path, typer.Option(help="folder for the table; run again to go on")],
    data: Annotated[
        Path | None,
        typer.Option(help="what ablations share: training sets, views, camouflages; OUT/../data if left out"),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="few variants, frames and steps: minutes, not hours")] = False,
    seeds: Annotated[
        int | None, typer.Option(min=1, help="camouflages per variant; as many as fit two hours if left out")
    ] = None,
    variants: Annotated[str | None, typer.Option(help="keys of some variants only, comma separated")] = None,
    steps: Annotated[int | None, typer.Option(min=1, help="of every optimization")] = None,
    batch: Annotated[int | None, typer.Option(min=1, help="frames per step")] = None,
    lr: Annotated[float | None, typer.Option(help="Adam's, on sRGB values, for rows that name no method")] = None,
    frames: Annotated[int | None, typer.Option(min=1, help="of every training set")] = None,
    held_out: Annotated[int | None, typer.Option(min=2, help="frames to measure on, per weather set")] = None,
    weathers: Annotated[str | None, typer.Option(help="seen, unseen, both, or a preset's name or .json file")] = None,
    size: Annotated[int | None, typer.Option(min=64, help="frames are square, pixels")] = None,
    samples: Annotated[int | None, typer.Option(min=1, help="Cycles samples per pixel before denoising")] = None,
    map_size: Annotated[int | None, typer.Option(min=64, help="side of the UV map, texels")] = None,
    vehicle: Annotated[str, typer.Option(help="shipped vehicle's name, or a vehicle folder")] = "sedan",
    attack: Annotated[
        list[str] | None, typer.Option(help="detector to optimize against; repeat for several; yolov3-tiny if left out")
    ] = None,
    detectors: Annotated[
        str | None, typer.Option(help="to measure with, comma separated; all that are ready and not this project's own")
    ] = None,
    threads: Threads = None,
    device: Device = "cpu",
    slurm: Slurm = None,
    blender: Blender = None,
    render_device: RenderDevice = "cpu",
) -> None:
    """Optimize variants, measure all on the same held-out views, and hold the paper's orderings against them."""
    from rauca_core.report import write_ablation
    from rauca_core.study.ablate import ablate as run
    from rauca_core.study.ablations.experiment import QUICK, Sizes

    sizes = resized(
        QUICK if quick else Sizes(), steps=steps, batch=batch, lr=lr, frames=frames, held_out=held_out, pixels=size,
        samples=samples, map_size=map_size, seeds=seeds, weathers=weathers and tuple(split_names([weathers])),
        detectors=detectors and tuple(split_names([detectors])),
    )  # fmt: skip
    with means_of(device, slurm, blender, render_device, threads) as means:
        found = run(
            name, out, variants=split_names([variants or ""]), quick=quick, sizes=sizes, vehicle=vehicle,
            attacked=attack or ["yolov3-tiny"], store=data or out.parent / "data",
            command=command_line(), **means,
        )  # fmt: skip
    console.print(f"ablation: {write_ablation(found, out / 'ablation.html')[0]}", highlight=False, soft_wrap=True)
