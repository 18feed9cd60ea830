"""``rauca optimize``: a camouflage against one or several detectors.

``torchrun --nproc-per-node N -m pipelines optimize ...`` shares every step between N processes.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Annotated, Any

import typer

import rauca_core as rauca
from rauca_core.contract import OptimizeProgress

from .console import console, line_writer, progress_bar
from .naturalness import (
    FeatureSize,
    MaxDeltaE,
    PaletteColors,
    PaletteOption,
    Reference,
    ReferenceWeight,
    ReferenceWidth,
    Symmetric,
    natural_settings,
)
from .options import Seed, Threads, machine_option

if TYPE_CHECKING:
    from rauca_core.attack import StepReport
    from rauca_core.study.defences.informed import DefendedDetector

attack_option = partial(typer.Option, rich_help_panel="The attack in detail")
renderer_option = partial(typer.Option, rich_help_panel="Renderer, light and map")
RECENT_STEPS = 50  # that the time left is judged by


def optimize(
    context: typer.Context,
    dataset: Annotated[Path, typer.Argument(help="data set with light maps")],
    out: Annotated[
        Path, typer.Option(help="folder for the camouflage, its history and checkpoints; run again to go on")
    ],
    detector: Annotated[
        list[str] | None,
        typer.Option(
            help="a name or file, see `rauca detectors list`; repeat to attack several; the method's own by default"
        ),
    ] = None,
    defence: Annotated[
        str | None, typer.Option(help="attack them behind this defence, such as jpeg or lgs:block=9, and knowing of it")
    ] = None,
    weight: Annotated[
        list[float] | None, attack_option(help="of each detector, in the same order; equal if left out")
    ] = None,
    target: Annotated[
        str | None, typer.Option(help="the class to hide, as detectors call it; the vehicle's own if left out")
    ] = None,
    method: Annotated[
        str,
        typer.Option(
            help="whose settings to begin with: ours, das, fca, dta, active, rauca-base or rauca-final (the paper); "
            "options given here win over them"
        ),
    ] = "ours",
    fidelity: Annotated[
        str | None,
        typer.Option(
            "--as", help="the method as published, or adapted (our renderer, exact light): see `rauca methods`"
        ),
    ] = None,
    steps: Annotated[int, typer.Option(help="of the optimization")] = 3000,
    batch: Annotated[int | None, attack_option(help="frames per step")] = None,
    lr: Annotated[float | None, attack_option(help="Adam's learning rate, on sRGB values")] = None,
    decay: Annotated[
        float | None, attack_option(help="last learning rate as a share of the first; 1 as published")
    ] = None,
    objective: Annotated[
        str | None, attack_option(help="eq6 (the paper's), log-score (pushes small scores as hard), or a rival's")
    ] = None,
    beta: Annotated[float | None, attack_option(help="weight of the smoothness loss, Eq. 8")] = None,
    smooth: Annotated[
        str | None,
        attack_option(help="where paint is smooth: map, unclamped, picture or pattern"),
    ] = None,
    map_size: Annotated[int | None, renderer_option(help="side of the UV map, texels")] = None,
    samples: Annotated[int | None, renderer_option(help="subsamples per pixel and axis of the neural renderer")] = None,
    sampler: Annotated[
        str | None,
        renderer_option(help="area (ours), bilinear, trilinear, tensor-traversal (Algorithm 1) or uv-traversal (2)"),
    ] = None,
    views: Annotated[
        str | None, renderer_option(help="rendered frames, or dense: new cameras in their places at every step")
    ] = None,
    light: Annotated[
        str | None,
        renderer_option(
            help="exact, irradiance (see `dataset light`), ours (the extractor's), published, transfer, none"
        ),
    ] = None,
    extractor: Annotated[
        Path | None, renderer_option(help="weights of --light published, or of ours in place of the shipped ones")
    ] = None,
    paint: Annotated[
        str | None, renderer_option(help="what is free: texels of the UV map, facets, or a pattern repeated all over")
    ] = None,
    start: Annotated[
        str | None, attack_option(help="random or plain; of tanh: tanh-unit (FCA's) or tanh-wide (RAUCA-base's)")
    ] = None,
    begin_with: Annotated[Path | None, typer.Option(help="camouflage .json to begin with, of this vehicle")] = None,
    limit: Annotated[
        str | None, attack_option(help="keep texels in range by project (ours), clamp (as published) or tanh")
    ] = None,
    roa: Annotated[bool | None, attack_option("--roa/--no-roa", help="random output augmentation")] = None,
    augmentation: Annotated[
        str | None,
        attack_option(
            help="its ranges: rauca (the paper's), published (the code's), active, zoomed (ours, near and far)"
        ),
    ] = None,
    rest: Annotated[
        int | None, attack_option(help="epochs to leave out frames in which the vehicle is no longer seen")
    ] = None,
    window: Annotated[
        int | None,
        attack_option(help="frames of a clip that follow each other in a step; the most visible counts most"),
    ] = None,
    window_temperature: Annotated[
        float | None, attack_option(help="of a window's softmax, in units of the loss; the lower, the more it counts")
    ] = None,
    turns: Annotated[
        bool | None,
        attack_option("--turns/--all-at-once", help="a step attacks one of the detectors, the next step the next"),
    ] = None,
    detector_size: Annotated[
        int | None,
        attack_option(
            help="side of the detectors' input, pixels, where it is free; theirs if left out, 320 for the panel of ours"
        ),
    ] = None,
    precision: Annotated[str | None, machine_option(help="of the detectors: float32 or bfloat16")] = None,
    palette_of: PaletteOption = None,
    palette_colors: PaletteColors = 4,
    feature_size: FeatureSize = None,
    symmetric: Symmetric = None,
    reference: Reference = None,
    reference_width: ReferenceWidth = 2.0,
    reference_weight: ReferenceWeight = 0.0,
    max_delta_e: MaxDeltaE = None,
    seed: Seed = 0,
    device: Annotated[str | None, machine_option(help="to optimize on, such as cuda:1; a GPU if there is one")] = None,
    threads: Threads = None,
    name: Annotated[str | None, typer.Option(help="of the camouflage, in tables; the method's if left out")] = None,
    json_progress: Annotated[
        bool, machine_option("--json-progress", help="each step as a line of JSON on standard output, for programs")
    ] = False,
) -> None:
    """Optimize a camouflage UV map against one or several detectors."""
    from rauca_core.study.job import steps_told

    settings = {**chosen_settings(context), **natural_settings(context)}
    against: Sequence[DefendedDetector | str] = detector or ()
    if defence:
        against, settings["detector_size"] = _behind(defence, detector or (), method, detector_size)
    console.quiet = os.environ.get("RANK", "0") != "0"  # one process of several speaks
    tell = _lines(out) if json_progress else None
    with progress_bar("optimizing") as move:
        step, view = steps_told(move)

        def show(report: StepReport) -> None:
            step(report)
            if tell is not None:
                tell(report)

        made = rauca.optimize(
            dataset, against, settings.pop("method"), out=out, device=device,
            on_step=show, on_view=view, **settings,
        )  # fmt: skip
    console.print(f"camouflage: {made.path}")


def _behind(
    defence: str, named: Sequence[str], method: str, size: int | None
) -> tuple[list[DefendedDetector], int | None]:
    """The detectors that are attacked, or the method's own panel, each behind a defence, and the size of pictures."""
    from rauca_core.attack import load_attacked, method_named
    from rauca_core.study.defences import make_defence
    from rauca_core.study.defences.informed import DefendedDetector

    made, (names, side) = make_defence(defence), method_named(method).attacked(named, size)
    return [DefendedDetector(load_attacked(name, side), made) for name in names], side


def _lines(out: Path) -> Callable[[StepReport], None]:
    """Prints each step as a line of JSON; once nobody reads it any more, the run goes on alone."""
    from rauca_core.attack.history import PICTURE, UV_MAP

    recent: deque[float] = deque(maxlen=RECENT_STEPS)
    pictures = str((out / PICTURE).absolute()), str((out / UV_MAP).absolute())
    say = line_writer()

    def tell(report: StepReport) -> None:
        recent.append(report.seconds)
        left_s = (report.steps - report.step) * median(recent)
        losses = report.loss, report.attack, report.smooth, report.score
        say(OptimizeProgress(report.step, report.steps, *losses, report.seconds, left_s, *pictures).line())

    return tell


def chosen_settings(context: typer.Context) -> dict[str, Any]:
    """What `rauca_core.optimize` takes: the options that were given, by name; the method's settings are the rest."""
    from rauca_core.attack import OptimizerSettings

    params = context.params
    given = {name: params[name] for name in OptimizerSettings.model_fields if params.get(name) is not None}
    return {**given, "weights": tuple(params["weight"] or ()) or None}
