"""``rauca dataset ...``: make and inspect multi-weather data sets."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from blender_addon.arguments import dataset_parser

from .blender_process import run_blender
from .console import progress_bar

dataset_app = typer.Typer(help="Make and inspect multi-weather data sets.", no_args_is_help=True)

PASS_ON = {"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []}
Blender = Annotated[Path | None, typer.Option(help="Blender program; without it the bpy wheel is used")]


@dataset_app.command("make", context_settings=PASS_ON)
def dataset_make(context: typer.Context, blender: Blender = None) -> None:
    """Render a data set: every view in every weather. `rauca dataset make --help` lists the options."""
    dataset_parser().parse_args(context.args)
    with progress_bar("rendering data set") as move:
        run_blender("make_dataset", [*context.args, "--json-progress"], move, blender)
