"""Data sets on a Slurm cluster: a job array with one task per shard, submitted through submitit.

Tasks write into the same folder, which all machines must see; each keeps a ledger of its own. A task that ends early
is no loss: the same command submits what is missing.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from rauca_core.contract import MakeDataset, Progress, RaucaError, Shard, frame_states, save_job
from rauca_core.runtime.blender import blender_command
from rauca_core.runtime.cluster import Cluster, failure


def slurm_parser() -> argparse.ArgumentParser:
    """The options of ``rauca dataset make`` that concern the cluster."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    add = parser.add_argument_group("on a Slurm cluster").add_argument
    add("--slurm", action="store_true", help="submit the work as a job array instead of doing it here")
    add("--shards", type=int, default=1, help="tasks that the data set is split into")
    add("--partition", help="of the cluster; its default if left out")
    add("--time", type=int, default=24 * 60, help="limit of a task, minutes")
    add("--memory", type=float, default=8.0, help="of a task, GB")
    add("--cpus", type=int, default=8, help="of a task")
    add("--no-wait", action="store_true", help="return once submitted")
    return parser


def refuse_without_slurm(options: argparse.Namespace) -> None:
    """Raise :class:`RaucaError` when options ask something of a cluster, and none is to be used."""
    for name, default in vars(slurm_parser().parse_args([])).items():
        if not options.slurm and getattr(options, name) != default:
            raise RaucaError(f"--{name.replace('_', '-')}: is of a Slurm cluster; give --slurm too, or leave it out")


def render_on_slurm(
    options: argparse.Namespace,
    job: MakeDataset,
    blender: Path | None,
    move: Callable[[Progress], None],
) -> str:
    """Submit the shards of a data set and, unless told otherwise, wait for them.

    Args:
        options: of :func:`slurm_parser`.
        job: is cut into shards; their jobs and logs go to ``<out>.slurm`` beside the data set.
        move: called with the progress of all tasks together.

    Returns:
        The array's job id.

    Raises:
        RaucaError: there is no Slurm or submitit here, the cluster refuses the job, or tasks failed.
    """
    folder = job.out
    if job.shard.count > 1:
        raise RaucaError("--shard: with --slurm every shard is submitted; give --shards N instead")
    if options.shards < 1:
        raise RaucaError(f"--shards {options.shards}: must be at least 1")
    cluster = Cluster("slurm", options.partition, options.time, options.memory, options.cpus)
    cluster.require()
    logs = Path(f"{folder.absolute()}.slurm")
    shards = [Shard(index, options.shards) for index in range(1, options.shards + 1)]
    commands = []
    for shard in shards:
        path = logs / f"shard-{shard.index}.json"
        commands.append(blender_command(path, blender))
        save_job(path, replace(job, shard=shard))
    tasks = cluster.submit(commands, logs)
    array = str(tasks[0].job_id).partition("_")[0]
    if options.no_wait:
        return array
    cluster.wait(tasks, lambda waiting: tell_frames(job, f"{waiting} of {len(tasks)} tasks left", move))
    failed = [f"{shard}: {reason}" for shard, task in zip(shards, tasks, strict=True) if (reason := failure(task))]
    if failed:
        raise RaucaError(f"{folder}: {len(failed)} of {len(tasks)} shards failed, {failed[0]} (logs in {logs})")
    return array


def tell_frames(job: MakeDataset, last: str, move: Callable[[Progress], None]) -> None:
    """The progress of all tasks together: frames of the job that are settled, whoever rendered them."""
    if (job.out / "dataset.json").is_file():
        asked = {frame.id for frame in job.wanted()}
        settled = sum(state != "failed" for frame, state in frame_states(job.out).items() if frame in asked)
        move(Progress(settled, len(asked), last))
