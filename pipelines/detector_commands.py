"""``rauca detectors ...`` and ``rauca weights ...``: what is ready, what is missing, and getting it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table
from rich.text import Text

from rauca_core.contract import Progress, RaucaError, format_duration
from rauca_core.contract.files import write_json

from .console import command_line, console, output, progress_bar
from .options import Device, Seed, Threads, machine_option

if TYPE_CHECKING:
    import rich.console

    from rauca_core.detect import Detector
    from rauca_core.study.cost import Cost
    from rauca_core.study.preflight import Preflight
    from rauca_core.training.loop import RoundReport
    from rauca_core.training.measure import Findings

detectors_app = typer.Typer(help="Detectors: what is ready, what the others need.", no_args_is_help=True)
weights_app = typer.Typer(help="Get detector weights.", no_args_is_help=True)

Names = Annotated[list[str] | None, typer.Argument(help="names from `rauca weights list`")]
Classes = Annotated[
    str | None, typer.Option(help="which of its classes are what data sets call them: vehicle.car=car,vehicle.van=car")
]
ClassNames = Annotated[
    Path | None, typer.Option("--names", help="file of the network's classes in its order, one a line")
]
Every = Annotated[bool, typer.Option("--all", help="the seven of the standard evaluation")]
From = Annotated[
    Path | None,
    typer.Option("--from", help="look in this folder first; files are known by sha256", envvar="RAUCA_WEIGHTS"),
]

TABLE_WIDTH = 100
OTHERS = (
    "Any other detector: a .weights, .pb, .caffemodel, .onnx or .safetensors by its path. An ONNX graph that "
    "onnx2torch cannot convert has no gradients: it can be evaluated, not attacked."
)


@detectors_app.command("list")
def detectors_list() -> None:
    """Show every known detector: its family, training data, licence, and what it needs to run."""
    from rauca_core.detect.weights import listing

    listed = listing()
    table = Table("name", "family", "trained on", "licence", "gradients", "state", title="rauca detectors")
    for entry in listed:
        source = entry.source
        state = Text(entry.state, "green" if entry.ready else "")
        table.add_row(source.name, source.family, source.trained_on, source.licence, "yes", state)
    wide = output(TABLE_WIDTH)
    wide.print(table)
    for entry in listed:
        for remedy in entry.remedies:
            wide.print(Text.assemble((entry.source.name, "bold"), f": {remedy}"), soft_wrap=True)
    wide.print(OTHERS, soft_wrap=True, highlight=False)


@detectors_app.command("check")
def detectors_check(
    detector: Annotated[str, typer.Argument(help="a name of `rauca detectors list`, or a file of yours")],
    classes: Classes = None,
    names: ClassNames = None,
    size: Annotated[int | None, typer.Option(help="side of the network's input, pixels; its own by default")] = None,
    device: Device = "cpu",
    json: Annotated[Path | None, typer.Option(help="write what was found to this file too")] = None,
) -> None:
    """Look at a detector before it is assessed: does it see plain cars, has it gradients, what will it cost?

    Exit code 1 where something should be seen to first.
    """
    from rauca_core.study.assess import works_of
    from rauca_core.study.preflight import preflight

    loaded = open_detector(detector, classes, names, size, device)
    with console.status(f"looking through {loaded.name}"):
        found = preflight(loaded, works=works_of(), device=device)
    if json:
        write_json(json, found.to_json())
    show_preflight(found, output(TABLE_WIDTH))
    if found.warnings:
        raise typer.Exit(1)


def open_detector(name: str, classes: str | None, names: Path | None, size: int | None, device: str) -> Detector:
    """The detector that a command names, under the classes that it is to have."""
    from rauca_core.detect import load_detector, parse_classes
    from rauca_core.detect.classes import read_names

    listed = None if names is None else read_names(names)
    return load_detector(name, size, device, listed, parse_classes(classes) if classes else None)


def show_preflight(found: Preflight, where: rich.console.Console) -> None:
    """A preflight as a table, and its warnings below."""
    table = Table("what", "found", title=f"a look at {found.name}")
    for what, shown in _checked(found).items():
        table.add_row(what, shown)
    where.print(table)
    for warning in found.warnings:
        console.print(Text.assemble(("warning", "yellow"), f": {warning}"), soft_wrap=True)


def _checked(found: Preflight) -> dict[str, str]:
    """A preflight in words."""
    size, step, called = found.input_size, found.ms_step, found.class_names[found.class_index]
    return {
        "family": found.family,
        "classes": f"{len(found.class_names)}; cars are class {found.class_index}, {called!r}",
        "input": f"{size} pixels, its longer side" if size else "as large as the image asks for",
        "gradients": "yes" if found.differentiable else "no: it can be evaluated, not attacked",
        "plain cars": f"AP@0.5 {found.ap:.2f}; {found.found} of {found.pictures} found at a score of 0.25",
        "an image": f"{found.ms_forward:.0f} ms" + (f", {step:.0f} ms with the way back" if step is not None else ""),
    } | {f"{name} assessment": _cost(cost) for name, cost in found.costs.items()}


def _cost(cost: Cost) -> str:
    parts = {"rendering": cost.render_s, "looking": cost.look_s, "attacking": cost.attack_s}
    told = ", ".join(f"{what} {format_duration(seconds)}" for what, seconds in parts.items() if seconds)
    return f"about {format_duration(cost.seconds)} ({told}); {cost.disk_bytes / 2**20:.0f} MiB"


@detectors_app.command("train")
def detectors_train(
    name: Annotated[str, typer.Argument(help="frcnn-synth or detr-synth")],
    datasets: Annotated[list[Path], typer.Argument(help="data sets with light maps, of one image size")],
    out: Annotated[Path, typer.Option(help="folder for the weights, their card and checkpoints; run again to go on")],
    test: Annotated[list[Path] | None, typer.Option("--test", help="data set to test on; repeat for more")] = None,
    steps: Annotated[int, typer.Option(help="of the training")] = 600,
    batch: Annotated[int, typer.Option(help="images per step")] = 8,
    lr: Annotated[float | None, typer.Option(help="AdamW's learning rate; the detector's own by default")] = None,
    size: Annotated[int, typer.Option(help="side of the network's input, pixels")] = 320,
    classes: Annotated[
        str, typer.Option(help="to tell apart beside car, comma-separated; those with 100 boxes by default")
    ] = "",
    start: Annotated[Path | None, typer.Option(help="weights of an earlier training to begin with")] = None,
    every: Annotated[int, typer.Option(help="steps between tests and checkpoints")] = 100,
    precision: Annotated[str, machine_option(help="float32 or bfloat16")] = "float32",
    seed: Seed = 0,
    threads: Threads = None,
    device: Annotated[str, machine_option(help="that learns and tests: cpu, cuda, cuda:1 ...")] = "cpu",
    remarks: Annotated[str, typer.Option(help="for the card")] = "",
) -> None:
    """Train a detector of our own, two-stage or transformer, on plain cars in data sets."""
    from rauca_core.detect.synth.networks import find_recipe
    from rauca_core.study.harden_rounds import score
    from rauca_core.training.fit import Fit, fit
    from rauca_core.training.measure import ALL
    from rauca_core.training.settings import DetectorSettings

    chosen = {"steps": steps, "batch": batch, "lr": lr, "size": size, "round": every, "precision": precision}
    chosen |= {"seed": seed, "threads": threads}
    given = {option: value for option, value in chosen.items() if value is not None}
    settings = DetectorSettings.make(**{"lr": find_recipe(name).lr, **given})
    told = [one.strip() for one in classes.split(",") if one.strip()]
    wanted = Fit(
        name=name, datasets=datasets, out=out, settings=settings, score=score, tests=test or [], start=start,
        classes=told, command=command_line(short=True), remarks=remarks, device=device,
    )  # fmt: skip
    said = ""
    with progress_bar("training") as move:

        def show_step(done: int, steps: int, loss: float) -> None:
            move(Progress(done, steps, f"loss {loss:.3f}  {said}"))

        def show_round(report: RoundReport[Findings]) -> None:
            nonlocal said
            said = f"AP@0.5 {report.findings.ap50[ALL]:.3f}"
            if not console.is_terminal:
                console.print(f"step {report.step}/{report.steps}  loss {report.loss:.3f}  {said}")

        weights, found = fit(wanted, show_round, show_step)
    table = Table("on", "AP@0.5", "frames", title=f"{name} on frames held out, class car")
    for group, ap in {**found.ap50, **found.by_vehicle}.items():
        table.add_row(group, f"{ap:.3f}", str(found.frames[group]))
    output().print(table)
    for thing, share in found.false_alarms.items():
        console.print(f"{thing}: taken for a car in {share:.0%} of {found.frames[thing]} frames")
    console.print(f"weights: {weights}")


@weights_app.command("list")
def weights_list() -> None:
    """Show the weights that can be fetched, their licences and whether they are here."""
    from rauca_core.detect import SOURCES, status

    table = Table("name", "licence", "MiB", "state")
    for name, state in status().items():
        size = f"{SOURCES[name].size_bytes / 2**20:.0f}" if SOURCES[name].size_bytes else "?"
        table.add_row(name, SOURCES[name].licence, size, state)
    output().print(table)


@weights_app.command("fetch")
def weights_fetch(names: Names = None, everything: Every = False, folder: From = None) -> None:
    """Get weights by name, verified by sha256; what cannot be had does not keep the others from coming."""
    from rauca_core.detect.catalogue import SOURCES
    from rauca_core.detect.weights import fetch_all

    standard = [source.name for source in SOURCES.values() if source.standard] if everything else []
    wanted = list(dict.fromkeys([*(names or []), *standard]))
    if not wanted:
        raise RaucaError("nothing to fetch; give names from `rauca weights list`, or --all")
    with console.status(f"fetching {len(wanted)}"):
        paths, errors = fetch_all(wanted, folder)
    for name, path in paths.items():
        console.print(f"{name}: {path}", soft_wrap=True)
    if len(wanted) == len(errors) == 1:
        raise errors[wanted[0]]
    if errors:
        for error in errors.values():
            console.print(str(error), style="red", soft_wrap=True)
        raise RaucaError(f"{len(errors)} of {len(wanted)} could not be fetched: {', '.join(errors)}; see above")


@weights_app.command("nutnet")
def weights_nutnet(
    data: Annotated[list[Path], typer.Argument(help="data sets, or folders of PNG pictures, of plain vehicles")],
    seed: Seed = 0,
) -> None:
    """Teach the defence nutnet what plain frames look like; half a minute."""
    import torch

    from rauca_core.runtime.images import read_image
    from rauca_core.study.defences.nutnet import train

    found = [sorted(folder.glob("frames/*/image.png")) or sorted(folder.glob("*.png")) for folder in data]
    for folder, paths in zip(data, found, strict=True):
        if not paths:
            raise RaucaError(f"{folder}: holds neither a data set's frames nor PNG pictures")
    with console.status("learning"):
        pictures = [torch.tensor(read_image(path)).permute(2, 0, 1) / 255 for paths in found for path in paths]
        weights = train(pictures, seed)
    console.print(f"nutnet: learnt from {len(pictures)} pictures: {weights}", soft_wrap=True)
