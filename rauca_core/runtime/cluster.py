"""Commands as the tasks of a job array, on a Slurm cluster or as processes here, through submitit.

Tasks write into folders that all machines must see. A task that ends early is no loss: the same command submits what
is missing. A data set is rendered as one task per shard, each of which keeps a ledger of its own.
"""

from __future__ import annotations

import shutil
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from ..contract import MakeDataset, Progress, RaucaError, Shard, frame_states, save_job
from .blender import blender_command, reason_of

POLL_S = 3.0
SHARED_DISK_LAG_S = 30.0  # a network file system may show a task's result this long after its end


@dataclass(frozen=True)
class Cluster:
    """Where tasks run, and what each may use.

    Attributes:
        kind: ``local`` starts them here, all at once: for tests, and machines of many cores.
        partition: the cluster's default if None.
        minutes: limit of a task.
    """

    kind: Literal["slurm", "local"] = "slurm"
    partition: str | None = None
    minutes: int = 24 * 60
    memory_gb: float = 8.0
    cpus: int = 8

    def run(self, commands: Sequence[Sequence[str]], logs: Path, report: Callable[[Progress], None]) -> list[str]:
        """Run commands to their ends; returns why each failed, empty for those that did not."""
        jobs = self.submit(commands, logs)

        def look(waiting: int) -> None:
            report(Progress(len(jobs) - waiting, len(jobs), f"{waiting} of {len(jobs)} tasks left"))

        self.wait(jobs, look)
        return [failure(job) for job in jobs]

    def require(self) -> None:
        """Raise :class:`RaucaError` where there is no Slurm."""
        if self.kind == "slurm" and shutil.which("sbatch") is None:
            raise RaucaError("--slurm: there is no sbatch here; run this on a login node of a Slurm cluster")

    def submit(self, commands: Sequence[Sequence[str]], logs: Path) -> list[Any]:
        """Submit commands as one array; returns submitit's jobs.

        Args:
            logs: folder for what they print.

        Raises:
            RaucaError: there is no Slurm or submitit here, or the cluster refuses the job.
        """
        self.require()
        try:
            import submitit
        except ImportError:
            raise RaucaError("--slurm: submitit is missing; `pip install rauca[slurm]`") from None
        executor = submitit.AutoExecutor(folder=logs, cluster=self.kind)
        executor.update_parameters(
            name="rauca", timeout_min=self.minutes, mem_gb=self.memory_gb, cpus_per_task=self.cpus,
            slurm_array_parallelism=len(commands),
        )  # fmt: skip
        if self.partition:
            executor.update_parameters(slurm_partition=self.partition)
        try:
            return list(executor.map_array(run_task, commands))
        except submitit.core.utils.FailedJobError as error:
            raise RaucaError(f"--slurm: the cluster refused the job: {' '.join(str(error).split())}") from None

    def wait(self, jobs: Sequence[Any], look: Callable[[int], None]) -> None:
        """Wait for the tasks of an array; ``look`` is called every now and then with how many are left.

        Raises:
            RaucaError: Ctrl-C; tasks on a cluster go on.
        """
        array = str(jobs[0].job_id).partition("_")[0]
        try:
            while True:
                waiting = [job for job in jobs if not job.paths.result_pickle.exists()]
                look(len(waiting))
                if not waiting:
                    return
                if not self._listed(array, waiting):
                    time.sleep(SHARED_DISK_LAG_S if self.kind == "slurm" else 0.0)
                    return
                time.sleep(POLL_S if self.kind == "slurm" else 0.1)
        except KeyboardInterrupt:
            if self.kind == "slurm":
                raise RaucaError(f"interrupted; job {array} goes on without us, `scancel {array}` ends it") from None
            for job in jobs:
                job.cancel()
            raise

    def _listed(self, array: str, waiting: Sequence[Any]) -> bool:
        """Whether any task is pending or running; of Slurm squeue is asked, as accounting may be off."""
        if self.kind == "local":
            return any(not job.done() for job in waiting)
        asked = subprocess.run(["squeue", "--noheader", "--jobs", array], capture_output=True, text=True, check=False)
        if asked.returncode:
            return "Invalid job id" not in asked.stderr  # else the controller is out of reach for now
        return bool(asked.stdout.strip())


def run_task(command: Sequence[str]) -> str:
    """What a task runs; returns why it failed, or nothing."""
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True, errors="replace", check=False)
    print(done.stderr, flush=True)
    return reason_of("task", done.returncode, done.stderr.splitlines(), "it") if done.returncode else ""


def failure(job: Any) -> str:
    """Why a task failed; empty if it did not."""
    if not job.paths.result_pickle.exists():
        return f"the task ended without a result; see {job.paths.stderr}"
    if error := job.exception():
        return " ".join(str(error).split())
    return str(job.result())


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
