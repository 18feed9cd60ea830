"""The ``rauca`` command.

No torch here, nor in what this module imports: functions import what they run, so that help, data sets and mistakes
answer at once.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from rauca_core.contract import ApplyCamouflage, RaucaError, VehicleSource
from rauca_core.runtime.blender import run_blender
from rauca_core.runtime.stopping import take_sigterm_for_ctrl_c
from rauca_core.version import __version__

from .ablate import ablate
from .assess import assess
from .bench_commands import bench_app
from .cache import cache_app
from .compare import compare
from .console import console, output, progress_bar
from .dataset_commands import dataset_app
from .demo import demo
from .detector_commands import detectors_app, weights_app
from .efe_commands import efe_app
from .evaluate import evaluate, report
from .harden import harden
from .methods import methods
from .optimize import optimize
from .options import Blender, PaintMask, PaintMaterial
from .picture_commands import picture_app
from .tradeoff import tradeoff

EXTRAS = {
    "bpy": "dataset",
    "xatlas": "dataset",
    "tensorboard": "optimize",
    "matplotlib": "report",
    "faster_coco_eval": "report",
    "jinja2": "report",
}
"""Which extra of rauca brings a package that a command has missed."""
app = typer.Typer(
    name="rauca",
    epilog="How robust is a detector: `rauca assess mine.onnx --out runs/mine`. The whole way, small: `rauca demo`. "
    "What is missing here: `rauca doctor`.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
START, DATA, ATTACK, EVALUATE, HARDEN, EXPERT = (
    "Start", "Data", "Attack", "Evaluate", "Harden", "For experts",
)  # fmt: skip
GROUPS: Mapping[str, tuple[typer.Typer, str]] = {
    "dataset": (dataset_app, DATA), "picture": (picture_app, DATA), "efe": (efe_app, EXPERT),
    "detectors": (detectors_app, EVALUATE), "weights": (weights_app, START), "bench": (bench_app, EXPERT),
    "cache": (cache_app, EXPERT),
}  # fmt: skip
COMMANDS: Mapping[str, tuple[Callable[..., None], ...]] = {
    START: (demo,),
    ATTACK: (optimize, methods, tradeoff, ablate),
    EVALUATE: (assess, evaluate, compare, report),
    HARDEN: (harden,),
}
"""Every command, under the heading that `rauca --help` shows it below."""


def _print_version(asked: bool) -> None:
    if asked:
        output().print(f"rauca {__version__}", highlight=False)
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", help="print the version and end", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Measure and harden vehicle detectors against adversarial camouflage."""


def _build() -> None:
    for heading, commands in COMMANDS.items():
        for command in commands:
            app.command(rich_help_panel=heading)(command)
    for name, (group, heading) in GROUPS.items():
        app.add_typer(group, name=name, rich_help_panel=heading)


_build()


def run(*command: str) -> None:
    """Entry point: a user's mistake becomes one line on standard error and exit code 2.

    Args:
        command: put before what the user typed, for programs that stand for one command.
    """
    take_sigterm_for_ctrl_c()
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


@app.command(rich_help_panel=ATTACK)
def apply(
    camouflage: Annotated[Path, typer.Argument(help="camouflage .json file")],
    out: Annotated[Path, typer.Option(help="the .blend to write")],
    vehicle: Annotated[str, typer.Option(help="shipped vehicle's name, its folder, or an .obj, .glb or .blend")] = (
        "sedan"
    ),
    paint_mask: PaintMask = None,
    paint_material: PaintMaterial = None,
    blender: Blender = None,
) -> None:
    """Save a vehicle in camouflage as a .blend."""
    if out.suffix != ".blend":
        raise RaucaError(f"{out}: --out must end in .blend")
    job = ApplyCamouflage(out, camouflage, VehicleSource(vehicle, paint_mask, paint_material))
    with progress_bar("painting", resumes=False) as move:
        run_blender(job, move, blender)
    console.print("saved; open it in Blender, or append its object to a scene of yours")


@app.command(rich_help_panel=START)
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


def missing(error: ModuleNotFoundError) -> str:
    """What to do about a package that is not installed.

    Raises:
        ModuleNotFoundError: the same, of a module that no extra brings: a fault of ours.
    """
    package = (error.name or "").partition(".")[0]
    if package not in EXTRAS:
        raise error
    return f"{package} is not installed; get it with `pip install 'rauca[{EXTRAS[package]}]'`"
