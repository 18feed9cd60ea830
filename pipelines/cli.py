"""The ``rauca`` command."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from blender_addon.arguments import apply_parser, dataset_parser
from rauca_core.contract import RaucaError
from rauca_core.detect.store import fetch, status

from .blender_process import run_blender
from .console import console, progress_bar

app = typer.Typer(
    name="rauca",
    help="Measure and harden vehicle detectors against adversarial camouflage.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
dataset_app = typer.Typer(help="Make and inspect multi-weather data sets.", no_args_is_help=True)
weights_app = typer.Typer(help="Get detector weights.", no_args_is_help=True)
bench_app = typer.Typer(help="Measure speed against error.", no_args_is_help=True)
app.add_typer(dataset_app, name="dataset")
app.add_typer(weights_app, name="weights")
app.add_typer(bench_app, name="bench")

PASS_ON = {"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []}
Blender = Annotated[Path | None, typer.Option(help="Blender program; without it the bpy wheel is used")]


def run() -> None:
    """Entry point: a user's mistake becomes one line on standard error and exit code 2."""
    try:
        app()
    except RaucaError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("interrupted: what was finished is kept; run the same command to go on", file=sys.stderr)
        sys.exit(2)


@dataset_app.command("make", context_settings=PASS_ON)
def dataset_make(context: typer.Context, blender: Blender = None) -> None:
    """Render a data set: every view in every weather, with light maps. `rauca dataset make --help` lists the options."""
    dataset_parser().parse_args(context.args)
    with progress_bar("rendering data set") as move:
        run_blender("make_dataset", [*context.args, "--json-progress"], move, blender)


@app.command("apply", context_settings=PASS_ON)
def apply(context: typer.Context, blender: Blender = None) -> None:
    """Save a vehicle in camouflage as a .blend. `rauca apply --help` lists the options."""
    apply_parser().parse_args(context.args)
    with progress_bar("painting") as move:
        run_blender("apply_camouflage", context.args, move, blender)
    console.print("saved; open it in Blender, or append its object to a scene of yours")


@app.command()
def doctor() -> None:
    """Print versions, devices and what is missing."""
    from .doctor import findings

    table = Table("what", "found", "", title="rauca doctor")
    ready = True
    for finding in findings():
        table.add_row(finding.what, finding.found, "ok" if finding.ok else f"[red]{finding.remedy}")
        ready &= finding.ok
    Console().print(table)
    if not ready:
        raise typer.Exit(1)


@weights_app.command("list")
def weights_list() -> None:
    """Show the known weights, their licences and whether they are here."""
    table = Table("name", "licence", "MiB", "state")
    for entry in status():
        table.add_row(entry.source.name, entry.source.licence, f"{entry.source.size_bytes / 2**20:.0f}", entry.state)
    Console().print(table)


@weights_app.command("fetch")
def weights_fetch(names: Annotated[list[str], typer.Argument(help="names from `rauca weights list`")]) -> None:
    """Get weights by name, verified by size and sha256."""
    for name in names:
        console.print(f"{name}: {fetch(name)}")
