"""Options that several commands share."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from rauca_core.contract import Progress, RaucaError

from .console import progress_bars, progress_lines

if TYPE_CHECKING:
    from rauca_core.study.engine import Means
    from rauca_core.study.executors import OnCluster

Sizes = TypeVar("Sizes", bound=Any)

machine_option = partial(typer.Option, rich_help_panel="Where it runs")
Blender = Annotated[Path | None, machine_option(help="Blender program; without it the bpy wheel is used")]
Device = Annotated[str, machine_option(help="of torch, for all that runs on it: cpu, cuda, cuda:1, mps ...")]
RenderDevice = Annotated[str, machine_option(help="of Cycles: cpu, gpu, or auto, which is a GPU where there is one")]
Slurm = Annotated[
    str | None,
    machine_option(
        help="do heavy work by tasks of a Slurm cluster: `default`, or partition=P,minutes=N,memory_gb=N,cpus=N"
    ),
]
JsonProgress = Annotated[bool, machine_option("--json-progress", help="progress as JSON lines, for programs")]
Threads = Annotated[int | None, machine_option(min=1, help="of torch; its own choice by default")]
Seed = Annotated[int, typer.Option(help="of all that is drawn by chance")]
PaintMask = Annotated[Path | None, typer.Option(help="grey PNG, white where the camouflage may go")]
PaintMaterial = Annotated[str | None, typer.Option(help="name of the material to camouflage")]


@contextlib.contextmanager
def means_of(
    device: str,
    slurm: str | None,
    blender: Path | None,
    render_device: str,
    threads: int | None = None,
    json_progress: bool = False,
) -> Iterator[Means]:
    """With what a study is made, as the options say; within, its progress is shown."""
    executor, tell = executor_of(slurm), progress_lines()
    with progress_bars() as show:

        def on_progress(title: str, progress: Progress) -> None:
            show(title, progress)
            if json_progress:
                tell(title, progress)

        yield {
            "device": device, "threads": threads, "blender": blender, "render_device": render_device,
            "executor": executor, "on_progress": on_progress,
        }  # fmt: skip


def resized(sizes: Sizes, **given: Any) -> Sizes:
    """Sizes with what was given in the place of their own."""
    chosen: Sizes = replace(sizes, **{name: value for name, value in given.items() if value is not None})
    return chosen


def numbers(option: str, text: str) -> tuple[float, ...]:
    """A comma separated list of numbers; raises :class:`RaucaError` naming the option for what is none."""
    try:
        return tuple(float(part) for part in text.split(",") if part.strip())
    except ValueError:
        raise RaucaError(f"{option} {text}: not a comma separated list of numbers") from None


def split_names(given: Sequence[str] | None) -> list[str]:
    """Values of a repeatable option, each of which may be several, comma separated."""
    return [part for value in given or () for part in value.split(",") if part]


def executor_of(slurm: str | None) -> OnCluster | None:
    """Who makes a study's artifacts; None for this process. Raises :class:`RaucaError` for what is no such option."""
    if slurm is None:
        return None
    from rauca_core.runtime.cluster import Cluster
    from rauca_core.study.executors import OnCluster

    kinds: dict[str, Any] = {"kind": str, "partition": str, "minutes": int, "memory_gb": float, "cpus": int}
    chosen = {}
    for part in slurm.split(",") if slurm != "default" else ():
        name, _, value = part.partition("=")
        try:
            chosen[name] = kinds[name](value)
        except (KeyError, ValueError):
            known = ", ".join(kinds)
            raise RaucaError(
                f"--slurm {slurm}: {part!r} is none of {known}, each with a value; or write default"
            ) from None
    return OnCluster(Cluster(**chosen))
