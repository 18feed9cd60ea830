"""``rauca dataset ...``: make and inspect multi-weather data sets."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path
from typing import Annotated, Any

import typer

from blender_addon.arguments import dataset_parser

from .blender_process import run_blender
from .console import console, progress_bar
from .slurm import render_on_slurm, slurm_parser

dataset_app = typer.Typer(help="Make and inspect multi-weather data sets.", no_args_is_help=True)

PASS_ON = {"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []}
MERGED: dict[str, Any] = {"conflict_handler": "resolve", "allow_abbrev": False}  # both parents know --help
Blender = Annotated[Path | None, typer.Option(help="Blender program; without it the bpy wheel is used")]


@dataset_app.command("make", context_settings=PASS_ON)
def dataset_make(context: typer.Context, blender: Blender = None) -> None:
    """Render a data set: every view in every weather. `rauca dataset make --help` lists the options."""
    cluster, arguments = slurm_parser().parse_known_args(context.args)
    every_option = ArgumentParser(prog="rauca dataset make", parents=[dataset_parser(), slurm_parser()], **MERGED)
    options = every_option.parse_args(context.args)
    with progress_bar("rendering data set") as move:
        if cluster.slurm:
            job = render_on_slurm(cluster, options.out, arguments, blender, move)
        else:
            run_blender("make_dataset", [*arguments, "--json-progress"], move, blender)
    if cluster.slurm:
        console.print(f"Slurm job {job}" + (" submitted" if cluster.no_wait else " finished"))
