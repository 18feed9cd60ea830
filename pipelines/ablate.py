"""``rauca ablate``: variants of one optimization, all measured on the same held-out views."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from .console import command_line, console, progress_bars
from .options import Blender, RenderDevice, Slurm, executor_of, split_names

Data = Annotated[
    Path | None,
    typer.Option(
        help="folder that ablations share: training sets, views, optimized camouflages; OUT/../data if left out"
    ),
]


def ablate(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help="baselines, renderer, dataset, beta, augmentation, environment, views, limit, sampling or paint",
        ),
    ],
    out: Annotated[Path, typer.Option(help="folder for the table; run again to resume")],
    data: Data = None,
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
    resamples: Annotated[int, typer.Option(min=1, help="of the bootstrap behind the intervals")] = 1000,
    threads: Annotated[int | None, typer.Option(min=1, help="of torch; its own choice by default")] = None,
    device: Annotated[str, typer.Option(help="of torch: of optimizations and detectors")] = "cpu",
    slurm: Slurm = None,
    blender: Blender = None,
    render_device: RenderDevice = "cpu",
) -> None:
    """Optimize variants, measure all on the same held-out views, and hold the paper's orderings against them."""
    from rauca_core.report import write_ablation
    from rauca_core.study.ablate import ablate as run
    from rauca_core.study.ablations import DEFAULT, QUICK

    given: dict[str, Any] = {
        "steps": steps, "batch": batch, "lr": lr, "frames": frames, "held_out": held_out, "pixels": size,
        "samples": samples, "map_size": map_size, "seeds": seeds,
        "weathers": None if weathers is None else tuple(split_names([weathers])),
        "detectors": None if detectors is None else tuple(split_names([detectors])),
    }  # fmt: skip
    sizes = replace(QUICK if quick else DEFAULT, **{k: v for k, v in given.items() if v is not None})
    with progress_bars() as on_progress:
        found = run(
            name,
            out,
            variants=split_names([variants or ""]),
            quick=quick,
            sizes=sizes,
            vehicle=vehicle,
            attacked=attack or ["yolov3-tiny"],
            store=data or out.parent / "data",
            resamples=resamples,
            threads=threads,
            device=device,
            blender=blender,
            render_device=render_device,
            executor=executor_of(slurm),
            on_progress=on_progress,
            command=command_line(),
        )
    console.print(f"ablation: {write_ablation(found, out / 'ablation.html')[0]}", highlight=False, soft_wrap=True)
