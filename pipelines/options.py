"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rauca_core.contract import RaucaError

if TYPE_CHECKING:
    from rauca_core.study.executors import OnCluster

Blender = Annotated[Path | None, typer.Option(help="Blender program; without it the bpy wheel is used")]
Device = Annotated[str, typer.Option(help="of torch, for all that runs on it: cpu, cuda, cuda:1, mps ...")]
RenderDevice = Annotated[str, typer.Option(help="of Cycles: cpu, gpu, or auto, which is a GPU where there is one")]
Slurm = Annotated[
    str | None,
    typer.Option(
        help="do heavy work by tasks of a Slurm cluster: `default`, or partition=P,minutes=N,memory_gb=N,cpus=N"
    ),
]


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
