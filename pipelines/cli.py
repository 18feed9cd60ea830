"""The ``rauca`` command.

No torch here, nor in what this module imports: functions import what they run, so that help, data sets and mistakes
answer at once.
"""

from __future__ import annotations

import importlib
import signal
import sys
from pathlib import Path
from types import FrameType, ModuleType
from typing import Annotated, NoReturn

import typer
from rich.table import Table
from rich.text import Text

from blender_addon.arguments import apply_parser
from rauca_core.contract import Dataset, RaucaError
from rauca_core.runtime.blender import run_blender

from .ablate_command import ablate
from .console import console, output, progress_bar
from .dataset_commands import PASS_ON, Blender, dataset_app
from .detector_commands import detectors_app, weights_app
from .efe_commands import efe_app
from .evaluate_command import evaluate
from .extras import missing
from .harden_command import harden
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
from .tradeoff_command import tradeoff

app = typer.Typer(
    name="rauca",
    help="Measure and harden vehicle detectors against adversarial camouflage.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
bench_app = typer.Typer(help="Measure speed against error.", no_args_is_help=True)
app.add_typer(dataset_app, name="dataset")
app.add_typer(efe_app, name="efe")
app.add_typer(detectors_app, name="detectors")
app.add_typer(weights_app, name="weights")
app.add_typer(bench_app, name="bench")
app.command()(evaluate)
app.command()(tradeoff)
app.command()(ablate)
app.command()(harden)


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
    apply_parser().parse_args(context.args)
    with progress_bar("painting", resumes=False) as move:
        run_blender("apply_camouflage", context.args, move, blender)
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
    path = optimize_camouflage(dataset, detectors, settings, out, resume, json_progress)
    console.print(f"camouflage: {path}")


@app.command()
def report(
    study: Annotated[Path, typer.Argument(metavar="STUDY", help="folder of a study, or one laid out as the demo's")],
    latex: Annotated[bool, typer.Option("--latex", help="write the tables as LaTeX too, to STUDY/report.tex")] = False,
    pictures: Annotated[Path | None, typer.Option(help="save the main figures to this folder too")] = None,
) -> None:
    """Write STUDY/report.html, and its numbers as report.csv and report.json, from what STUDY holds."""
    from .report import picture_run, report_run

    console.print(f"report: {report_run(study, latex)}")
    for path in picture_run(study, pictures) if pictures else ():
        console.print(f"picture: {path}")


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="folder of the run; run again to resume")] = Path("runs/demo"),
    vehicle: Annotated[str, typer.Option(help="shipped vehicle's name, or an .obj, .glb or .blend")] = "sedan",
    paint_mask: Annotated[Path | None, typer.Option(help="grey PNG, white where the camouflage may go")] = None,
    paint_material: Annotated[str | None, typer.Option(help="name of the material to camouflage")] = None,
    blender: Blender = None,
) -> None:
    """The main job: data set, camouflage, re-rendered views, AP@0.5, report. About half an hour on two cores."""
    from .demo import DemoChoice, run_demo

    run_demo(DemoChoice(out, _vehicle_arguments(vehicle, paint_mask, paint_material), blender))


@bench_app.command("render")
def bench_render_command(
    vehicle: Annotated[
        str | None, typer.Option(help="measure this one beside the sedan: a folder, .obj, .glb or .blend")
    ] = None,
    paint_mask: Annotated[Path | None, typer.Option(help="grey PNG, white where the camouflage may go")] = None,
    paint_material: Annotated[str | None, typer.Option(help="name of the material to camouflage")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="fewer views and sizes: two minutes, not fifteen")] = False,
    blender: Annotated[bool, typer.Option(help="compare with Cycles too")] = True,
    docs: Annotated[
        Path | None, typer.Option(help="renew the figures and pictures of renderer.md in this folder too")
    ] = None,
    json: Annotated[Path, typer.Option(help="where to write the figures")] = Path("reports/render.json"),
) -> None:
    """The neural renderer's speed and error, beside other renderers, Embree and Cycles."""
    _benchmark("render.bench").bench_render(json, vehicle, paint_mask, paint_material, quick, blender, docs)


@bench_app.command("environment")
def bench_environment_command(
    quick: Annotated[bool, typer.Option("--quick", help="less data and training: four minutes, not an hour")] = False,
    weights: Annotated[
        Path | None, typer.Option(help="pre-trained extractor to fine-tune; the shipped one by default")
    ] = None,
    docs: Annotated[
        Path | None, typer.Option(help="renew the figures and pictures of environment.md in this folder too")
    ] = None,
    json: Annotated[Path, typer.Option(help="where to write the figures")] = Path("reports/environment.json"),
) -> None:
    """Every way to light a vehicle against Cycles; training times; what pre-training saves."""
    _benchmark("environment.bench").bench_environment(json, quick, docs, weights)


@bench_app.command("dataset")
def bench_dataset_command(
    quick: Annotated[bool, typer.Option("--quick", help="one view, fewer settings: three minutes, not twenty")] = False,
    docs: Annotated[
        Path | None, typer.Option(help="renew the figures and plots of datasets.md in this folder too")
    ] = None,
    json: Annotated[Path, typer.Option(help="where to write the figures")] = Path("reports/dataset.json"),
) -> None:
    """What a frame costs and how far it is from the converged one: samples, denoiser, bounces, fog, whole sets."""
    _benchmark("dataset.bench").bench_dataset(json, quick, docs)


@bench_app.command("optimize")
def bench_optimize_command(
    quick: Annotated[bool, typer.Option("--quick", help="fewer frames and steps: one minute, not four")] = False,
    docs: Annotated[Path | None, typer.Option(help="renew the figures of optimizer.md in this folder too")] = None,
    json: Annotated[Path, typer.Option(help="where to write the figures")] = Path("reports/optimize.json"),
) -> None:
    """Milliseconds of an optimization step by stage, and with Algorithm 2 in place of taps."""
    _benchmark("optimize.bench").bench_optimize(json, quick, docs)


@bench_app.command("detect")
def bench_detect_command(
    quick: Annotated[bool, typer.Option("--quick", help="fewer images and architectures: a minute or two")] = False,
    dataset: Annotated[
        Path | None, typer.Option(help="detect in its frames; the demo's or drawn pictures by default")
    ] = None,
    docs: Annotated[Path | None, typer.Option(help="renew the figures of detectors.md in this folder too")] = None,
    json: Annotated[Path, typer.Option(help="where to write the figures")] = Path("reports/detect.json"),
) -> None:
    """Every detector adapter beside the runtime its network comes from: differences and speed."""
    _benchmark("detect.bench").bench_detect(json, quick, docs, dataset)


@bench_app.command("agreement")
def bench_agreement_command(
    dataset: Annotated[Path, typer.Argument(help="data set with light maps")],
    camouflage: Annotated[Path, typer.Option(help="camouflage .json to compare in")],
    json: Annotated[Path, typer.Option(help="where to write the figures")] = Path("reports/agreement.json"),
) -> None:
    """The neural renderer's distance from Cycles on the frames of a data set."""
    _benchmark("agreement").bench_agreement(dataset, camouflage, json)


@bench_app.command("vehicle")
def bench_vehicle_command(
    vehicle: Annotated[str, typer.Option(help="shipped vehicle's name, or an .obj, .glb or .blend")] = "sedan",
    paint_mask: Annotated[Path | None, typer.Option(help="grey PNG, white where the camouflage may go")] = None,
    paint_material: Annotated[str | None, typer.Option(help="name of the material to camouflage")] = None,
    detector: Annotated[list[str] | None, typer.Option(help="repeat for more; all fetched ones by default")] = None,
    json: Annotated[Path, typer.Option(help="where to write the figures")] = Path("reports/vehicle.json"),
) -> None:
    """Do detectors take the plain vehicle for a car, from every side?"""
    chosen = _vehicle_arguments(vehicle, paint_mask, paint_material)
    _benchmark("vehicle").bench_vehicle(chosen, detector or _fetched(), json)


@bench_app.command("defences")
def bench_defences_command(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="folder of a finished `rauca demo`")],
    detector: Annotated[
        list[str] | None, typer.Option(help="repeat for more; yolov3-tiny and yolov4-tiny by default")
    ] = None,
    patch: Annotated[float, typer.Option(help="share of the vehicle's box under the optimized patch")] = 0.25,
    quick: Annotated[bool, typer.Option("--quick", help="fewer views and steps: half a minute, not three")] = False,
    docs: Annotated[
        Path | None, typer.Option(help="renew the figures and the picture of defences.md in this folder too")
    ] = None,
    json: Annotated[Path, typer.Option(help="where to write the figures")] = Path("reports/defences.json"),
) -> None:
    """What LGS, PAD and cheap defences cost, do to clean views, and save from a camouflage and a patch."""
    detectors = detector or ["yolov3-tiny", "yolov4-tiny"]
    _benchmark("defences.bench").bench_defences(run_folder, detectors, json, quick, docs, patch)


@bench_app.command("jobs")
def bench_jobs_command(
    quick: Annotated[bool, typer.Option("--quick", help="fewer frames and kills: two minutes, not ten")] = False,
    json: Annotated[Path, typer.Option(help="where to write the figures")] = Path("reports/jobs.json"),
) -> None:
    """Data set jobs: memory over 500 frames; the same bytes after 20 SIGKILLs."""
    _benchmark("jobs").bench_jobs(json, quick)


@bench_app.command("stability")
def bench_stability_command(
    quick: Annotated[bool, typer.Option("--quick", help="10 steps a case of the optimizer, not 100")] = False,
    docs: Annotated[Path | None, typer.Option(help="renew the figures of stability.md in this folder too")] = None,
    json: Annotated[Path, typer.Option(help="where to write the figures")] = Path("reports/stability.json"),
) -> None:
    """Every hard case in three precisions: what must come of it and what does. Exit code 1 if one fails."""
    if not _benchmark("stability.bench").bench_stability(json, quick, docs):
        raise typer.Exit(1)


def _benchmark(name: str) -> ModuleType:
    try:
        return importlib.import_module(f"benchmarks.{name}")
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "benchmarks":
            raise  # a package that an extra brings
        raise RaucaError("benchmarks are part of a checkout, not of an installed rauca; run this in one") from error


def _vehicle_arguments(vehicle: str, paint_mask: Path | None, paint_material: str | None) -> list[str]:
    """The arguments of ``rauca dataset make`` that choose a vehicle."""
    chosen = ["--vehicle", vehicle]
    chosen += ["--paint-mask", str(paint_mask)] if paint_mask else []
    return chosen + (["--paint-material", paint_material] if paint_material else [])


def _fetched() -> list[str]:
    """Detectors whose weights are here."""
    from rauca_core.detect.listing import ready_names

    names = ready_names()
    if not names:
        raise RaucaError("no detector weights are here; get some with `rauca weights fetch --all`")
    return names


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
