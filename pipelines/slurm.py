"""Data sets on a Slurm cluster: a job array with one task per shard, submitted through submitit.

Tasks write into the same folder, which all machines must see; each keeps a ledger of its own. A task that ends early
is no loss: the same command submits what is missing.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rauca_core.contract import MakeDataset, Progress, RaucaError, Shard, frame_states, save_job
from rauca_core.runtime.blender import blender_command, reason_of

POLL_S = 3.0
SHARED_DISK_LAG_S = 30.0  # a network file system may show a task's result this long after its end


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
    if shutil.which("sbatch") is None:
        raise RaucaError("--slurm: there is no sbatch here; run this on a login node of a Slurm cluster")
    logs = Path(f"{folder.absolute()}.slurm")
    shards = [Shard(index, options.shards) for index in range(1, options.shards + 1)]
    commands = []
    for shard in shards:
        path = logs / f"shard-{shard.index}.json"
        commands.append(blender_command(path, blender))
        save_job(path, replace(job, shard=shard))
    jobs = _submit(options, logs, commands)
    array = str(jobs[0].job_id).partition("_")[0]
    if options.no_wait:
        return array
    try:
        _wait(jobs, array, job, move)
    except KeyboardInterrupt:
        raise RaucaError(f"interrupted; job {array} goes on without us, `scancel {array}` ends it") from None
    failed = [f"{shard}: {reason}" for shard, job in zip(shards, jobs, strict=True) if (reason := _failure(job))]
    if failed:
        raise RaucaError(f"{folder}: {len(failed)} of {len(jobs)} shards failed, {failed[0]} (logs in {logs})")
    return array


def run_shard(command: Sequence[str]) -> str:
    """What a task runs; returns why it failed, or nothing."""
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True, errors="replace", check=False)
    print(done.stderr, flush=True)
    return reason_of("make_dataset", done.returncode, done.stderr.splitlines()) if done.returncode else ""


def _submit(options: argparse.Namespace, logs: Path, commands: list[list[str]]) -> list[Any]:
    try:
        import submitit
    except ImportError:
        raise RaucaError("--slurm: submitit is missing; `pip install rauca[slurm]`") from None
    executor = submitit.AutoExecutor(folder=logs, cluster="slurm")
    executor.update_parameters(
        name="rauca", timeout_min=options.time, mem_gb=options.memory, cpus_per_task=options.cpus,
        slurm_array_parallelism=len(commands),
    )  # fmt: skip
    if options.partition:
        executor.update_parameters(slurm_partition=options.partition)
    try:
        return list(executor.map_array(run_shard, commands))
    except submitit.core.utils.FailedJobError as error:
        raise RaucaError(f"--slurm: the cluster refused the job: {' '.join(str(error).split())}") from None


def _wait(jobs: list[Any], array: str, asked_for: MakeDataset, move: Callable[[Progress], None]) -> None:
    asked = {frame.id for frame in asked_for.wanted()}
    while True:
        waiting = [job for job in jobs if not job.paths.result_pickle.exists()]
        if (asked_for.out / "dataset.json").is_file():
            states = frame_states(asked_for.out)
            settled = sum(state != "failed" for frame, state in states.items() if frame in asked)
            move(Progress(settled, len(asked), f"{len(waiting)} of {len(jobs)} tasks left"))
        if not waiting:
            return
        if not _listed(array):
            time.sleep(SHARED_DISK_LAG_S)
            return
        time.sleep(POLL_S)


def _listed(array: str) -> bool:
    """Whether any task of an array is pending or running; asks squeue, as accounting may be off."""
    asked = subprocess.run(["squeue", "--noheader", "--jobs", array], capture_output=True, text=True, check=False)
    if asked.returncode:
        return "Invalid job id" not in asked.stderr  # else the controller is out of reach for now
    return bool(asked.stdout.strip())


def _failure(job: Any) -> str:
    """Why a task failed; empty if it did not."""
    if not job.paths.result_pickle.exists():
        return f"the task ended without a result; see {job.paths.stderr}"
    if error := job.exception():
        return " ".join(str(error).split())
    return str(job.result())
