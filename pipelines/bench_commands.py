"""``rauca bench``: speed against error. The benchmarks are part of a checkout; here is only what users type."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Annotated, Any

import typer

from rauca_core.contract import RaucaError

from .options import PaintMask, PaintMaterial

bench_app = typer.Typer(help="Measure speed against error.", no_args_is_help=True)

Docs = Annotated[Path | None, typer.Option(help="renew this benchmark's figures and pictures in these pages too")]
Json = Annotated[Path, typer.Option(help="where to write the figures")]


def start(name: str, out: Path, quick: bool | None = None, **chosen: Any) -> Any:
    """Run ``bench`` of ``benchmarks/NAME.py``; returns its results.

    Args:
        quick: its ``QUICK`` settings, not its ``FULL`` ones; None for a benchmark that has none.
        chosen: what else it takes.

    Raises:
        RaucaError: this is no checkout.
    """
    module = load_benchmark(name)
    if quick is not None:
        chosen["settings"] = module.QUICK if quick else module.FULL
    return module.bench(out, **chosen)


def load_benchmark(name: str) -> Any:
    """The module ``benchmarks.NAME``."""
    try:
        return importlib.import_module(f"benchmarks.{name}")
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "benchmarks":
            raise  # a package that an extra brings
        raise RaucaError("benchmarks are part of a checkout, not of an installed rauca; run this in one") from error


@bench_app.command("render")
def bench_render_command(
    vehicle: Annotated[
        str | None, typer.Option(help="measure this one beside the sedan: a folder, .obj, .glb or .blend")
    ] = None,
    paint_mask: PaintMask = None,
    paint_material: PaintMaterial = None,
    quick: Annotated[bool, typer.Option("--quick", help="fewer views and sizes: two minutes, not fifteen")] = False,
    blender: Annotated[bool, typer.Option(help="compare with Cycles too")] = True,
    docs: Docs = None,
    json: Json = Path("reports/render.json"),
) -> None:
    """The neural renderer's speed and error, beside other renderers, Embree and Cycles."""
    chosen = {"vehicle": vehicle, "paint_mask": paint_mask, "paint_material": paint_material, "blender": blender}
    start("render", json, quick, docs=docs, **chosen)


@bench_app.command("environment")
def bench_environment_command(
    quick: Annotated[bool, typer.Option("--quick", help="less data and training: four minutes, not an hour")] = False,
    weights: Annotated[
        Path | None, typer.Option(help="pre-trained extractor to fine-tune; the shipped one by default")
    ] = None,
    maps_only: Annotated[
        bool, typer.Option("--maps-only", help="only light maps and irradiance textures, no extractor")
    ] = False,
    docs: Docs = None,
    json: Json = Path("reports/environment.json"),
) -> None:
    """Every way to light a vehicle against Cycles; training times; what pre-training saves."""
    start("environment", json, quick, docs=docs, weights=weights, maps_only=maps_only)


@bench_app.command("views")
def bench_views_command(
    quick: Annotated[bool, typer.Option("--quick", help="one car, one weather, small frames: minutes, not hours")] = (
        False
    ),
    sources: Annotated[
        Path | None, typer.Option(help="data set to compose from, in place of one rendered anew")
    ] = None,
    truth: Annotated[Path | None, typer.Option(help="data set of other cameras in the same places")] = None,
    docs: Docs = None,
    json: Json = Path("reports/views.json"),
) -> None:
    """Composed frames of new cameras against renders of them: error by part of the picture, and speed."""
    start("views", json, quick, docs=docs, sources=sources, truth=truth)


@bench_app.command("views-agreement")
def bench_views_agreement_command(
    dataset: Annotated[Path, typer.Argument(help="data set with light maps, with several views of each place")],
    camouflage: Annotated[
        list[Path] | None, typer.Option(help="show these .json too, beside the own and random paint; repeat for more")
    ] = None,
    detector: Annotated[list[str] | None, typer.Option(help="repeat for more; all fetched ones by default")] = None,
    frames: Annotated[int, typer.Option(min=2, help="that are composed from the others of their place")] = 200,
    device: Annotated[str, typer.Option(help="of torch")] = "cpu",
    json: Json = Path("reports/views-agreement.json"),
) -> None:
    """Do detectors see in composed frames what they see in rendered ones?"""
    start(
        "views_agreement", json, dataset=dataset, camouflages=camouflage or [], detectors=detector or ["all"],
        frames=frames, device=device,
    )  # fmt: skip


@bench_app.command("dataset")
def bench_dataset_command(
    quick: Annotated[bool, typer.Option("--quick", help="one view, fewer settings: three minutes, not twenty")] = False,
    docs: Docs = None,
    json: Json = Path("reports/dataset.json"),
) -> None:
    """What a frame costs and how far it is from the converged one: samples, denoiser, bounces, fog, whole sets."""
    start("dataset", json, quick, docs=docs)


@bench_app.command("optimize")
def bench_optimize_command(
    quick: Annotated[bool, typer.Option("--quick", help="fewer frames and steps: one minute, not four")] = False,
    docs: Docs = None,
    json: Json = Path("reports/optimize.json"),
) -> None:
    """Milliseconds of an optimization step by stage, and with Algorithm 2 in place of taps."""
    start("optimize", json, quick, docs=docs)


@bench_app.command("detect")
def bench_detect_command(
    quick: Annotated[bool, typer.Option("--quick", help="fewer images and architectures: a minute or two")] = False,
    dataset: Annotated[
        Path | None, typer.Option(help="detect in its frames; the demo's or drawn pictures by default")
    ] = None,
    docs: Docs = None,
    json: Json = Path("reports/detect.json"),
) -> None:
    """Every detector adapter beside the runtime its network comes from: differences and speed."""
    start("detect", json, quick, docs=docs, dataset=dataset)


@bench_app.command("agreement")
def bench_agreement_command(
    dataset: Annotated[Path, typer.Argument(help="data set with light maps")],
    camouflage: Annotated[Path, typer.Option(help="camouflage .json to compare in")],
    json: Json = Path("reports/agreement.json"),
) -> None:
    """The neural renderer's distance from Cycles on the frames of a data set."""
    start("agreement", json, dataset=dataset, camouflage=camouflage)


@bench_app.command("vehicle")
def bench_vehicle_command(
    vehicle: Annotated[str, typer.Option(help="shipped vehicle's name, or an .obj, .glb or .blend")] = "sedan",
    paint_mask: PaintMask = None,
    paint_material: PaintMaterial = None,
    detector: Annotated[list[str] | None, typer.Option(help="repeat for more; all fetched ones by default")] = None,
    json: Json = Path("reports/vehicle.json"),
) -> None:
    """Do detectors take the plain vehicle for a car, from every side?"""
    from rauca_core.detect.weights import ready_names

    detectors = detector or ready_names()
    if not detectors:
        raise RaucaError("no detector weights are here; get some with `rauca weights fetch --all`")
    chosen = ["--vehicle", vehicle, *(["--paint-mask", str(paint_mask)] if paint_mask else [])]
    chosen += ["--paint-material", paint_material] if paint_material else []
    start("vehicle", json, vehicle=chosen, detectors=detectors)


@bench_app.command("defences")
def bench_defences_command(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="folder of a finished `rauca demo`")],
    detector: Annotated[
        list[str] | None, typer.Option(help="repeat for more; yolov3-tiny and yolov4-tiny by default")
    ] = None,
    patch: Annotated[float, typer.Option(help="share of the vehicle's box under the optimized patch")] = 0.25,
    quick: Annotated[bool, typer.Option("--quick", help="fewer views and steps: half a minute, not three")] = False,
    docs: Docs = None,
    json: Json = Path("reports/defences.json"),
) -> None:
    """What LGS, PAD and cheap defences cost, do to clean views, and save from a camouflage and a patch."""
    detectors = detector or ["yolov3-tiny", "yolov4-tiny"]
    start("defences", json, quick, docs=docs, run=run_folder, detectors=detectors, patch=patch)


@bench_app.command("jobs")
def bench_jobs_command(
    quick: Annotated[bool, typer.Option("--quick", help="fewer frames and kills: two minutes, not ten")] = False,
    json: Json = Path("reports/jobs.json"),
) -> None:
    """Data set jobs: memory over 500 frames; the same bytes after 20 SIGKILLs."""
    start("jobs", json, quick)


@bench_app.command("stability")
def bench_stability_command(
    quick: Annotated[bool, typer.Option("--quick", help="25 steps a case of the optimizer, not 100")] = False,
    docs: Docs = None,
    json: Json = Path("reports/stability.json"),
) -> None:
    """Every hard case in three precisions: what must come of it and what does. Exit code 1 if one fails."""
    results = start("stability.bench", json, quick, docs=docs)
    if not all(target.passed for target in results.targets):
        raise typer.Exit(1)


@bench_app.command("statistics")
def bench_statistics_command(
    quick: Annotated[bool, typer.Option("--quick", help="a tenth of the simulated studies: a minute, not six")] = False,
    docs: Docs = None,
    json: Json = Path("reports/statistics.json"),
) -> None:
    """How often 95 % intervals hold the truth, and how often chance is called a finding: simulated studies."""
    start("statistics", json, quick, docs=docs)
