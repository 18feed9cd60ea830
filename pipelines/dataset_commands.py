"""``rauca dataset ...``: make and inspect multi-weather data sets."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Column, Table
from rich.text import Text

from rauca_core.contract import Progress
from rauca_core.contract.color import find_colors
from rauca_core.contract.files import write_json
from rauca_core.dataset_tools import (
    CheckResult,
    check_dataset,
    export_dataset,
    recolor_dataset,
    remove_damaged,
    view_dataset,
)
from rauca_core.dataset_tools.check import COUNTED, MIN_PSNR_DB
from rauca_core.runtime.blender import run_blender
from rauca_core.runtime.cluster import Cluster, render_on_cluster

from .console import console, output, progress_bar
from .dataset_options import dataset_job, dataset_parser, refuse_without_slurm, slurm_parser
from .options import Blender

dataset_app = typer.Typer(help="Make and inspect multi-weather data sets.", no_args_is_help=True)

PASS_ON = {"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []}
MERGED: dict[str, Any] = {"conflict_handler": "resolve", "allow_abbrev": False}  # both parents know --help
Folder = Annotated[Path, typer.Argument(metavar="DIR", help="folder of the data set")]


@dataset_app.command("make", context_settings=PASS_ON)
def dataset_make(context: typer.Context, blender: Blender = None) -> None:
    """Render a data set: every view in every weather. `rauca dataset make --help` lists the options."""
    every_option = ArgumentParser(prog="rauca dataset make", parents=[dataset_parser(), slurm_parser()], **MERGED)
    options = every_option.parse_args(context.args)
    refuse_without_slurm(options)
    job = dataset_job(options)
    with progress_bar("rendering data set", every_step=True) as bar:

        def move(progress: Progress) -> None:
            bar(progress)
            if options.json_progress:
                print(progress.line(), flush=True)

        if options.slurm:
            cluster = Cluster("slurm", options.partition, options.time, options.memory, options.cpus)
            array = render_on_cluster(job, options.shards, cluster, blender, None if options.no_wait else move)
        else:
            run_blender(job, move, blender)
    if options.slurm:
        console.print(f"Slurm job {array}" + (" submitted" if options.no_wait else " finished"))


@dataset_app.command("check")
def dataset_check(
    folder: Folder,
    min_psnr: Annotated[float, typer.Option(help="dB that recolored frames must reach against rendered ones")] = (
        MIN_PSNR_DB
    ),
    unfinished: Annotated[bool, typer.Option("--unfinished", help="frames not rendered yet are no finding")] = False,
    remove: Annotated[
        bool, typer.Option("--remove-damaged", help="damaged frames; `rauca dataset make` then renders them again")
    ] = False,
    json: Annotated[Path | None, typer.Option(help="write the findings to this file too")] = None,
) -> None:
    """Read every file and hold it against the others, the plan and the ledger; exit code 2 if anything is wrong."""
    with progress_bar("checking", resumes=False) as move:
        result = check_dataset(folder, min_psnr, unfinished, move)
    if json:
        write_json(json, result.to_json())
    output().print(_table(folder, result))
    for finding in result.findings:
        print(finding)
    for name in remove_damaged(folder, result) if remove else ():
        console.print(f"removed: {name}", highlight=False, soft_wrap=True)
    if result.findings:
        raise typer.Exit(2)


@dataset_app.command("view")
def dataset_view(
    folder: Folder,
    out: Annotated[Path, typer.Option(help="folder for the contact sheet, the overlays and index.html")],
    frame: Annotated[list[str] | None, typer.Option(help="lay this one open; repeat for more")] = None,
    view: Annotated[list[int] | None, typer.Option(help="a column of the contact sheet; repeat for more")] = None,
) -> None:
    """Write a contact sheet of weathers by views, and frames with their boxes and masks."""
    with progress_bar("drawing", resumes=False) as move:
        page = view_dataset(folder, out, frame or (), view or (), move)
    console.print(f"page: {page}")


@dataset_app.command("densify")
def dataset_densify(
    folder: Folder,
    out: Annotated[Path, typer.Option(help="folder of the new data set; run again to go on")],
    views: Annotated[int, typer.Option(help="how many new cameras, over all places and weathers")] = 1024,
    seed: Annotated[int, typer.Option(help="names the cameras' jitter")] = 0,
    threads: Annotated[int, typer.Option(help="frames composed at once", min=1)] = 2,
) -> None:
    """Write frames of new cameras in the rendered places, composed in milliseconds, to learn from, not to judge by."""
    from rauca_core.contract import Dataset
    from rauca_core.environment.views import Views, densify

    with progress_bar("composing") as move:
        made = densify(Views(Dataset(folder), views, seed=seed), out, move, threads)
    console.print(f"{len(made.begun())} frames: {out}")


@dataset_app.command("export")
def dataset_export(
    folder: Folder,
    form: Annotated[str, typer.Option("--format", help="coco or yolo")],
    out: Annotated[Path, typer.Option(help="folder for images and labels")],
    camouflage: Annotated[
        list[str] | None,
        typer.Option(help="FILE or LABEL=FILE: every frame in it, too; repeat for more", metavar="FILE"),
    ] = None,
) -> None:
    """Write images and boxes as COCO JSON or YOLO text, for other tools; in camouflages, too, to train on."""
    with progress_bar("exporting") as move:
        if camouflage:
            from rauca_core.study.camouflaged import export_camouflaged

            targets = export_camouflaged(folder, camouflage, form, out, move)
        else:
            targets = export_dataset(folder, form, out, move)
    console.print(f"{targets} targets: {out}")


@dataset_app.command("recolor")
def dataset_recolor(
    folder: Folder,
    out: Annotated[Path, typer.Option(help="images go to OUT/<color>/<frame>.png; run again to go on")],
    colors: Annotated[str, typer.Option(help="train (9), test (32), or sRGB colors like ff8800,8c8c8c")] = "train",
) -> None:
    """Write every frame in uniform colors, from its light maps: one multiply-add each."""
    chosen = find_colors(colors)
    with progress_bar("recoloring") as move:
        written = recolor_dataset(folder, chosen, out, move)
    console.print(f"{written} images written: {out}")


def _table(folder: Path, result: CheckResult) -> Table:
    longest = max(map(len, result.weathers))
    table = Table(Column("weather", min_width=longest), *COUNTED, "recoloring", title=str(folder))
    for name, weather in result.weathers.items():
        psnr = "" if weather.psnr_db is None else f"{weather.psnr_db:.1f} dB of {weather.checked}"
        table.add_row(name, *(str(weather.counts[state]) for state in COUNTED), psnr)
    sums = (str(sum(w.counts[state] for w in result.weathers.values())) for state in COUNTED)
    table.add_section()
    bad = len(result.findings)
    table.add_row("all", *sums, Text(f"{bad} findings", "red") if bad else Text("whole", "green"))
    return table


@dataset_app.command("light")
def dataset_light(folder: Folder) -> None:
    """Fit irradiance textures, the light on the vehicle in each place and weather; run again to go on."""
    from rauca_core.environment.place_light import light_places

    numbers = ("views", "seen", "texels unseen", "dB", "held out")
    table = Table("place", "weather", *(Column(name, justify="right") for name in numbers))
    with progress_bar("fitting light") as move:
        for light, _ in light_places(folder, move):
            worst = min(source.display_db for source in light.sources)
            apart = "" if light.held_out_db is None else f"{light.held_out_db:.1f}"
            told = (f"{len(light.sources)}", f"{light.seen:.0%}", f"{light.unseen}", f"{worst:.1f}", apart)
            table.add_row(f"L{light.location:02d}", light.weather, *told)
    output().print(table)
