"""The ``rauca`` command.

No torch here, nor in what this module imports: functions import what they run, so that help, data sets and mistakes
answer at once.
"""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Annotated, NoReturn

import typer
from rich.table import Table
from rich.text import Text

from rauca_core.contract import Dataset, RaucaError
from rauca_core.runtime.blender import run_blender

from .ablate import ablate
from .bench_commands import bench_app
from .cache import cache_app
from .console import console, output, progress_bar
from .dataset_commands import PASS_ON, dataset_app
from .dataset_options import apply_job, apply_parser
from .demo import demo
from .detector_commands import detectors_app, weights_app
from .efe_commands import efe_app
from .evaluate import evaluate
from .extras import missing
from .harden import harden
from .naturalness import (
    FeatureSize,
    MaxDeltaE,
    PaletteColors,
    PaletteOption,
    Reference,
    ReferenceWeight,
    ReferenceWidth,
    natural_settings,
)
from .options import Blender
from .report import report
from .tradeoff import tradeoff

app = typer.Typer(
    name="rauca",
    help="Measure and harden vehicle detectors against adversarial camouflage.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
app.add_typer(dataset_app, name="dataset")
app.add_typer(efe_app, name="efe")
app.add_typer(detectors_app, name="detectors")
app.add_typer(weights_app, name="weights")
app.add_typer(bench_app, name="bench")
app.add_typer(cache_app, name="cache")
app.command()(evaluate)
app.command()(tradeoff)
app.command()(ablate)
app.command()(harden)
app.command()(demo)
app.command()(report)


def run(*command: str) -> None:
    """Entry point: a user's mistake becomes one line on standard error and exit code 2.

    Args:
        command: put before what the user typed, for programs that stand for one command.
    """
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        app([*command, *sys.argv[1:]])
    except RaucaError as error:
        complaint = str(error)
    except ModuleNotFoundError as error:
        complaint = missing(error)
    except OSError as error:  # of a file that nobody else speaks for
        where = error.filename or "a file"
        complaint = f"{where}: {error.strerror or error}; see to the disk or choose another, then run the same command"
    else:
        return
    print(f"error: {complaint}", file=sys.stderr)
    sys.exit(2)


def _interrupt(number: int, stack: FrameType | None) -> NoReturn:
    """SIGTERM is Ctrl-C: what a job has started is stopped, what is finished is kept."""
    raise KeyboardInterrupt


@app.command("apply", context_settings=PASS_ON)
def apply(context: typer.Context, blender: Blender = None) -> None:
    """Save a vehicle in camouflage as a .blend. `rauca apply --help` lists the options."""
    job = apply_job(apply_parser().parse_args(context.args))
    with progress_bar("painting", resumes=False) as move:
        run_blender(job, move, blender)
    console.print("saved; open it in Blender, or append its object to a scene of yours")


@app.command()
def optimize(
    context: typer.Context,
    dataset: Annotated[Path, typer.Argument(help="data set with light maps")],
    out: Annotated[Path, typer.Option(help="folder for the camouflage, its history and checkpoints")],
    detector: Annotated[
        list[str] | None,
        typer.Option(
            help="a name or file, see `rauca detectors list`; repeat to attack several; yolov3-tiny by default"
        ),
    ] = None,
    weight: Annotated[
        list[float] | None, typer.Option(help="of each detector, in the same order; equal if left out")
    ] = None,
    target: Annotated[
        str | None, typer.Option(help="the class to hide, as detectors call it; the vehicle's own if left out")
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            help="settings of das, fca, dta, active, rauca-base, rauca-final or ours; options given here win over them"
        ),
    ] = None,
    steps: int = 1000,
    batch: Annotated[int, typer.Option(help="frames per step")] = 4,
    lr: Annotated[float, typer.Option(help="Adam's learning rate, on sRGB values")] = 0.01,
    decay: Annotated[float, typer.Option(help="last learning rate as a share of the first; 1 as published")] = 1.0,
    objective: Annotated[
        str, typer.Option(help="eq6 (the paper's), log-score (pushes small scores as hard), or a rival's")
    ] = "eq6",
    beta: Annotated[float, typer.Option(help="weight of the smoothness loss, Eq. 8")] = 0.01,
    smooth: Annotated[str, typer.Option(help="smoothness on the UV map, the rendered picture or the pattern")] = "map",
    map_size: Annotated[int, typer.Option(help="side of the UV map, texels")] = 1024,
    samples: Annotated[int, typer.Option(help="subsamples per pixel and axis of the neural renderer")] = 12,
    sampler: Annotated[
        str, typer.Option(help="area (ours), bilinear, trilinear, tensor-traversal (Algorithm 1) or uv-traversal (2)")
    ] = "area",
    light: Annotated[str, typer.Option(help="exact, ours (the extractor's), transfer or none")] = "exact",
    paint: Annotated[
        str, typer.Option(help="what is free: texels of the UV map, facets, or a pattern repeated all over")
    ] = "texels",
    start: Annotated[str, typer.Option(help="random or plain")] = "random",
    limit: Annotated[
        str, typer.Option(help="keep texels in range by project (ours), clamp (as published) or tanh")
    ] = "project",
    roa: Annotated[bool, typer.Option(help="random output augmentation")] = True,
    augmentation: Annotated[
        str, typer.Option(help="its ranges: rauca (as published), active, or ours (mirrored, and near and far)")
    ] = "rauca",
    rest: Annotated[int, typer.Option(help="epochs to leave out frames in which the vehicle is no longer seen")] = 0,
    precision: Annotated[str, typer.Option(help="of the detectors: float32 or bfloat16")] = "float32",
    palette_of: PaletteOption = None,
    palette_colors: PaletteColors = 4,
    feature_size: FeatureSize = None,
    reference: Reference = None,
    reference_width: ReferenceWidth = 2.0,
    reference_weight: ReferenceWeight = 0.0,
    max_delta_e: MaxDeltaE = None,
    seed: int = 0,
    device: Annotated[str | None, typer.Option(help="to optimize on, such as cuda:1; a GPU if there is one")] = None,
    threads: Annotated[int | None, typer.Option(help="of torch; its own choice by default")] = None,
    name: Annotated[str, typer.Option(help="of the camouflage, in tables")] = "rauca",
    resume: Annotated[bool, typer.Option(help="go on from the latest checkpoint in OUT")] = False,
    json_progress: Annotated[
        bool, typer.Option("--json-progress", help="each step as a line of JSON on standard output, for programs")
    ] = False,
) -> None:
    """Optimize a camouflage UV map against one or several detectors."""
    from rauca_core.attack import make_settings
    from rauca_core.study.contestants import read_vehicle_choice

    from .methods import chosen_settings
    from .optimize_camouflage import optimize_camouflage

    settings = make_settings(**{**chosen_settings(context), **natural_settings(context)})
    if target is None:
        hidden = read_vehicle_choice(Dataset(dataset).vehicle_folder).target
        settings = settings.model_copy(update={"target": hidden})
    detectors = detector or ["yolov3-tiny"]
    path = optimize_camouflage(dataset, detectors, settings, out, resume, json_progress, device)
    console.print(f"camouflage: {path}")


@app.command()
def doctor() -> None:
    """Print versions, devices and what is missing."""
    from .doctor import findings

    table = Table("what", "found", "", title="rauca doctor")
    ready = True
    for finding in findings():
        table.add_row(finding.what, finding.found, "ok" if finding.ok else Text(finding.remedy, "red"))
        ready &= finding.ok
    output().print(table)
    if not ready:
        raise typer.Exit(1)
