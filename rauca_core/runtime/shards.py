"""Data sets on a Slurm cluster: a job array with one task per shard.

Tasks write into the same folder, which all machines must see; each keeps a ledger of its own. A task that ends early
is no loss: the same command submits what is missing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from ..contract import MakeDataset, Progress, RaucaError, Shard, frame_states, save_job
from .blender import blender_command
from .cluster import Cluster, failure


def render_on_cluster(
    job: MakeDataset,
    shards: int,
    cluster: Cluster,
    blender: Path | None,
    report: Callable[[Progress], None] | None,
) -> str:
    """Submit the shards of a data set and wait for them.

    Args:
        job: is cut into shards; their jobs and logs go to ``<out>.slurm`` beside the data set.
        report: called with the progress of all tasks together; None to return once they are submitted.

    Returns:
        The array's job id.

    Raises:
        RaucaError: there is no Slurm or submitit here, the cluster refuses the job, or tasks failed.
    """
    if job.shard.count > 1:
        raise RaucaError("--shard: with --slurm every shard is submitted; give --shards N instead")
    if shards < 1:
        raise RaucaError(f"--shards {shards}: must be at least 1")
    cluster.require()
    logs = Path(f"{job.out.absolute()}.slurm")
    parts = [Shard(index, shards) for index in range(1, shards + 1)]
    commands = []
    for part in parts:
        path = logs / f"shard-{part.index}.json"
        commands.append(blender_command(path, blender))
        save_job(path, replace(job, shard=part))
    tasks = cluster.submit(commands, logs)
    if report is not None:
        cluster.wait(tasks, lambda waiting: tell_frames(job, f"{waiting} of {shards} tasks left", report))
        failed = [f"{part}: {reason}" for part, task in zip(parts, tasks, strict=True) if (reason := failure(task))]
        if failed:
            raise RaucaError(f"{job.out}: {len(failed)} of {shards} shards failed, {failed[0]} (logs in {logs})")
    return str(tasks[0].job_id).partition("_")[0]


def tell_frames(job: MakeDataset, last: str, report: Callable[[Progress], None]) -> None:
    """The progress of all tasks together: frames of the job that are settled, whoever rendered them."""
    if (job.out / "dataset.json").is_file():
        asked = {frame.id for frame in job.wanted()}
        settled = sum(state != "failed" for frame, state in frame_states(job.out).items() if frame in asked)
        report(Progress(settled, len(asked), last))
