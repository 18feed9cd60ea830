"""``rauca tradeoff``: what naturalness costs, from what the user types to a checked request."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rauca_core.contract import Dataset, RaucaError

from .console import command_line, console
from .naturalness import PaletteColors, PaletteOption, Reference, ReferenceWidth, make_naturalness
from .options import Blender, Device, RenderDevice, Seed, Slurm, Threads, means_of, numbers, resized, split_names

BOUNDS, FEATURES = "0,5,10,20,40", "10,20,40,80"
MOST = {"--max-delta-e": 1000, "--feature-size": 100_000}  # as `Naturalness` takes them
QUICK_BOUNDS, QUICK_FEATURES = "0,20", "40"


def tradeoff(
    dataset: Annotated[Path, typer.Argument(help="data set with light maps")],
    out: Annotated[Path, typer.Option(help="folder of the curve and all behind it; run again to go on")],
    reference: Reference = None,
    reference_width: ReferenceWidth = 2.0,
    bounds: Annotated[
        str | None,
        typer.Option("--max-delta-e", help=f"bounds on the distance in CIELAB, comma separated; {BOUNDS} by default"),
    ] = None,
    features: Annotated[
        str | None,
        typer.Option("--feature-size", help=f"smallest patches, cm; {FEATURES} by default; none to leave them out"),
    ] = None,
    palette_of: PaletteOption = None,
    palette_colors: PaletteColors = 4,
    detector: Annotated[list[str] | None, typer.Option(help="to attack; repeat for several")] = None,
    detectors: Annotated[
        str | None, typer.Option(help="to measure with, comma separated; all published ones that are ready by default")
    ] = None,
    steps: Annotated[int | None, typer.Option(min=1, help="of each optimization; 400 by default")] = None,
    batch: Annotated[int | None, typer.Option(min=1, help="frames per step; 4 by default")] = None,
    map_size: Annotated[int | None, typer.Option(help="side of the UV maps, texels; 512 by default")] = None,
    weathers: Annotated[str, typer.Option(help="of the held-out views: seen, unseen, both or a preset")] = "seen",
    frames: Annotated[int | None, typer.Option(min=1, help="held-out views per weather set; 64 by default")] = None,
    seed: Seed = 0,
    threads: Threads = None,
    quick: Annotated[bool, typer.Option("--quick", help="three points and few views: minutes, not an hour")] = False,
    device: Device = "cpu",
    slurm: Slurm = None,
    blender: Blender = None,
    render_device: RenderDevice = "cpu",
) -> None:
    """AP@0.5 against how natural a camouflage is: bounds on its distance from a reference, sizes of its patches."""
    from rauca_core.report import write_curve
    from rauca_core.study.tradeoff import QUICK, Sizes, points
    from rauca_core.study.tradeoff import tradeoff as run

    opened = Dataset(dataset)
    base = make_naturalness(palette_of, palette_colors, None, reference, reference_width)
    if reference is None and bounds:
        raise RaucaError("--max-delta-e: a distance to what? give a --reference")
    wanted_bounds = _numbers("--max-delta-e", bounds or (QUICK_BOUNDS if quick else BOUNDS)) if reference else ()
    given = features or (QUICK_FEATURES if quick else FEATURES)
    wanted_features = () if given == "none" else _numbers("--feature-size", given)
    attacked = list(dict.fromkeys(detector or ["yolov3-tiny"]))
    judges = split_names([detectors or ("yolov4-tiny" if quick else "all")])
    if set(judges) <= set(attacked):
        raise RaucaError("--detectors: none but the attacked; name others, or get weights with `rauca weights fetch`")
    sizes = resized(QUICK if quick else Sizes(), steps=steps, frames=frames, map_size=map_size, batch=batch)
    with means_of(device, slurm, blender, render_device, threads) as means:
        found = run(
            opened, points(base, wanted_bounds, wanted_features), out, attacked=attacked, detectors=judges,
            weathers=[weathers], sizes=sizes, seed=seed, command=command_line(), **means,
        )  # fmt: skip
    console.print(f"curve: {write_curve(found, out / 'tradeoff.html')[0]}", highlight=False, soft_wrap=True)


def _numbers(option: str, text: str) -> tuple[float, ...]:
    """What may be asked of a paint, each once, the least first."""
    found, most = sorted(set(numbers(option, text))), MOST[option]
    if not found or not all(0 <= value <= most for value in found):
        raise RaucaError(f"{option} {text}: not a comma separated list of numbers from 0 to {most:,}")
    if option == "--feature-size" and 0 in found:
        raise RaucaError(f"{option} {text}: a patch of 0 cm is none; the free camouflage is always among the points")
    return tuple(found)
