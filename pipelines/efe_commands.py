"""``rauca efe ...``: train, measure and use the environment feature extractor."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from rauca_core.contract import Progress, RaucaError
from rauca_core.contract.color import TEST, find_colors
from rauca_core.contract.files import png_bytes, write_bytes, write_json

from .console import command_line, console, output, progress_bar

if TYPE_CHECKING:
    from rauca_core.training.extractor import EpochReport

efe_app = typer.Typer(help="Light vehicles from one image: the environment feature extractor.", no_args_is_help=True)

Out = Annotated[Path, typer.Option(help="folder for the weights, checkpoints and tensorboard")]
Tests = Annotated[list[Path] | None, typer.Option("--test", help="data set to test on; repeat for more")]
Epochs = Annotated[int, typer.Option(help="at most")]
Batch = Annotated[int, typer.Option(help="frames per step, over all processes")]
Rate = Annotated[float, typer.Option(help="AdamW's learning rate")]
Split = Annotated[str, typer.Option(help="without --test, hold out a share of each: location or view")]
Size = Annotated[int | None, typer.Option(help="average frames down to this size, pixels; their own by default")]
Crop = Annotated[int, typer.Option(help="train on squares of this side around the paint, pixels; 0: whole frames")]
Mixed = Annotated[
    bool, typer.Option(help="every other frame whole, averaged down to the side of --crop, which must divide its own")
]
Early = Annotated[
    bool, typer.Option("--early-stop/--no-early-stop", help="stop by the paper's criterion of convergence")
]
Eta = Annotated[float, typer.Option(help="of that criterion, mean absolute error in sRGB values")]
Threads = Annotated[int | None, typer.Option(help="of torch; its own choice by default")]
Resume = Annotated[bool, typer.Option(help="go on from the latest checkpoint in OUT")]
Device = Annotated[str | None, typer.Option(help="to work on, such as cuda:1; a GPU if there is one")]
Weights = Annotated[Path | None, typer.Option(help="a .safetensors with its card; the shipped ones by default")]


@efe_app.command("train")
def efe_train(
    context: typer.Context,
    datasets: Annotated[
        list[Path], typer.Argument(help="data sets with light maps, of one image size unless --size is given")
    ],
    out: Out,
    test: Tests = None,
    epochs: Epochs = 40,
    batch: Batch = 4,
    lr: Rate = 2e-3,
    split: Split = "location",
    size: Size = None,
    crop: Crop = 80,
    mixed: Mixed = False,
    stop_early: Early = False,
    eta: Eta = 0.003,
    seed: int = 0,
    device: Device = None,
    threads: Threads = None,
    start: Annotated[Path | None, typer.Option(help="weights to begin with; drawn by the seed by default")] = None,
    remarks: Annotated[str, typer.Option(help="for the model card")] = "",
    resume: Resume = False,
) -> None:
    """Train our extractor on several vehicles."""
    _train(context, datasets, start)


@efe_app.command("finetune")
def efe_finetune(
    context: typer.Context,
    dataset: Annotated[Path, typer.Argument(help="data set of the new vehicle, with light maps")],
    out: Out,
    weights: Weights = None,
    test: Tests = None,
    epochs: Epochs = 40,
    batch: Batch = 4,
    lr: Rate = 1e-3,
    split: Split = "location",
    size: Size = None,
    crop: Crop = 80,
    mixed: Mixed = False,
    stop_early: Early = False,
    eta: Eta = 0.003,
    seed: int = 0,
    device: Device = None,
    threads: Threads = None,
    remarks: Annotated[str, typer.Option(help="for the model card")] = "",
    resume: Resume = False,
) -> None:
    """Adapt pre-trained weights to another vehicle."""
    from rauca_core.environment.weights import shipped_weights

    _train(context, [dataset], weights or shipped_weights())


@efe_app.command("evaluate")
def efe_evaluate(
    datasets: Annotated[list[Path], typer.Argument(help="data sets with light maps")],
    weights: Weights = None,
    device: Device = None,
    json: Annotated[Path | None, typer.Option(help="where to write the figures")] = None,
) -> None:
    """Measure our extractor, beside color transfer and none, against exact maps in 32 colors."""
    from rauca_core.environment import load_extractor
    from rauca_core.environment.metrics import compare
    from rauca_core.runtime.distributed import joined_processes

    net, _ = load_extractor(weights)
    with joined_processes(device) as process, progress_bar("evaluating", resumes=False) as move:
        found = compare(datasets, net.to(process.device), TEST, move)
    table = Table("weather", "method", "PSNR, dB", "MSE", "MAE", "BCE", "ms", title="light on the paint, sRGB values")
    for weather, methods in found.items():
        for method, row in methods.items():
            figures = (f"{row['psnr_db']:.2f}", *(f"{row[n]:.4f}" for n in ("mse", "mae", "bce")), f"{row['ms']:.1f}")
            table.add_row(weather, method, *figures)
    output().print(table)
    if json is not None:
        write_json(json, found)


@efe_app.command("preview")
def efe_preview(
    image: Annotated[Path, typer.Argument(help="a photograph or any image of the vehicle")],
    mask: Annotated[Path, typer.Argument(help="grey image of its size, white where the paint is")],
    out: Annotated[Path, typer.Option(help="PNG to write")],
    reference: Annotated[str, typer.Option(help="color of the paint in the image, sRGB like 8c8c8c")] = "8c8c8c",
    weights: Weights = None,
) -> None:
    """Show an image's light maps, and its vehicle in other colors and patterns, on one sheet."""
    from rauca_core.environment import load_extractor
    from rauca_core.environment.preview import preview

    colors = find_colors(reference)
    if len(colors) != 1:
        raise RaucaError(f"--reference {reference}: give one sRGB color like 8c8c8c")
    if out.suffix.lower() != ".png":
        raise RaucaError(f"{out}: --out must end in .png")
    net, _ = load_extractor(weights)
    write_bytes(out, png_bytes(preview(image, mask, colors[0], net)))
    console.print(f"preview: {out}")


def _train(context: typer.Context, datasets: list[Path], start: Path | None) -> None:
    """Train as the command's options say, with a progress bar."""
    from rauca_core.training.extractor_fit import Fit, fit
    from rauca_core.training.settings import ExtractorSettings

    given = context.params
    settings = ExtractorSettings.make(**{name: given[name] for name in ExtractorSettings.model_fields if name in given})
    wanted = Fit(
        datasets=datasets, out=given["out"], settings=settings, tests=given["test"] or (), start=start,
        command=command_line(short=True), remarks=given["remarks"], device=given["device"],
    )  # fmt: skip
    said = ""
    console.quiet = os.environ.get("RANK", "0") != "0"  # one process of several speaks
    with progress_bar("training") as move:

        def show_step(done: int, steps: int) -> None:
            move(Progress(done, steps, said))

        def show_epoch(report: EpochReport) -> None:
            nonlocal said
            said = f"epoch {report.epoch}/{report.epochs}  error {report.error:.4f}  best {report.best:.4f}"
            if not console.is_terminal:
                console.print(said)

        weights, outcome = fit(wanted, given["resume"], show_epoch, show_step)
    ended = f"converged at epoch {outcome.converged}" if outcome.converged else f"{len(outcome.errors) - 1} epochs"
    console.print(f"{ended}; best at {outcome.best_epoch}, mean absolute error {min(outcome.errors):.4f}")
    console.print(f"weights: {weights}")
