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
from .options import Seed, Threads, machine_option

if TYPE_CHECKING:
    from rauca_core.training.extractor import EpochReport

efe_app = typer.Typer(help="Light vehicles from one image: the environment feature extractor.", no_args_is_help=True)

Device = Annotated[str | None, machine_option(help="to work on, such as cuda:1; a GPU if there is one")]
Weights = Annotated[Path | None, typer.Option(help="a .safetensors with its card; the shipped ones by default")]


def efe_train(
    context: typer.Context,
    datasets: Annotated[
        list[Path], typer.Argument(help="data sets with light maps, of one image size unless --size is given")
    ],
    out: Annotated[Path, typer.Option(help="folder for the weights, checkpoints and tensorboard; run again to go on")],
    test: Annotated[list[Path] | None, typer.Option("--test", help="data set to test on; repeat for more")] = None,
    epochs: Annotated[int, typer.Option(help="at most")] = 40,
    batch: Annotated[int, typer.Option(help="frames per step, over all processes")] = 4,
    lr: Annotated[float | None, typer.Option(help="AdamW's learning rate; 0.002, to fine-tune 0.001")] = None,
    split: Annotated[str, typer.Option(help="without --test, hold out a share of each: location or view")] = "location",
    size: Annotated[
        int | None, typer.Option(help="average frames down to this size, pixels; their own by default")
    ] = None,
    crop: Annotated[
        int, typer.Option(help="train on squares of this side around the paint, pixels; 0: whole frames")
    ] = 80,
    mixed: Annotated[
        bool,
        typer.Option(help="every other frame whole, averaged down to the side of --crop, which must divide its own"),
    ] = False,
    stop_early: Annotated[
        bool, typer.Option("--early-stop/--no-early-stop", help="stop by the paper's criterion of convergence")
    ] = False,
    eta: Annotated[float, typer.Option(help="of that criterion, mean absolute error in sRGB values")] = 0.003,
    seed: Seed = 0,
    device: Device = None,
    threads: Threads = None,
    start: Annotated[
        Path | None,
        typer.Option("--start", "--weights", help="to begin with; drawn by the seed, to fine-tune the shipped ones"),
    ] = None,
    remarks: Annotated[str, typer.Option(help="for the model card")] = "",
) -> None:
    """Train as the options say; ``finetune`` has another beginning."""
    from rauca_core.environment.weights import shipped_weights
    from rauca_core.training.extractor_fit import Fit, fit
    from rauca_core.training.settings import ExtractorSettings

    given = {name: value for name, value in context.params.items() if name in ExtractorSettings.model_fields}
    if context.info_name == "finetune":
        start, given["lr"] = start or shipped_weights(), 1e-3 if lr is None else lr
    wanted = Fit(
        datasets=datasets, out=out, settings=ExtractorSettings.make(**given), tests=test or (), start=start,
        command=command_line(short=True), remarks=remarks, device=device,
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

        weights, outcome = fit(wanted, show_epoch, show_step)
    ended = f"converged at epoch {outcome.converged}" if outcome.converged else f"{len(outcome.errors) - 1} epochs"
    console.print(f"{ended}; best at {outcome.best_epoch}, mean absolute error {min(outcome.errors):.4f}")
    console.print(f"weights: {weights}")


efe_app.command("train", help="Train our extractor on several vehicles.")(efe_train)
efe_app.command("finetune", help="Adapt pre-trained weights to another vehicle.")(efe_train)


@efe_app.command("published")
def efe_published(
    dataset: Annotated[Path, typer.Argument(help="data set with light maps, of two locations or more")],
    out: Annotated[Path, typer.Option(help="folder for the weights and checkpoints; run again to go on")],
    epochs: Annotated[int, typer.Option(help="at most; the paper's criterion of convergence may end it sooner")] = 20,
    width: Annotated[
        str, typer.Option(help="channels: as in the paper, or a quarter of them, a sixteenth of the work")
    ] = "paper",
    device: Device = None,
    threads: Threads = None,
) -> None:
    """Train the paper's extractor, for `optimize --as published --extractor OUT/published.safetensors`."""
    from rauca_core.training.extractor_fit import fit_published

    with progress_bar("training") as move:

        def show_epoch(report: EpochReport) -> None:
            move(Progress(report.epoch, report.epochs, f"error {report.error:.4f}  best {report.best:.4f}"))

        weights = fit_published(dataset, out, epochs, threads, show_epoch, device, width)
    console.print(f"weights: {weights}")


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
