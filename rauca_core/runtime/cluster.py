"""Commands as the tasks of a job array, on a Slurm cluster or as processes here, through submitit.

Tasks write into folders that all machines must see. A task that ends early is no loss: the same command submits what
is missing.
"""

from __future__ import annotations

import shutil
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ..contract import Progress, RaucaError
from .blender import reason_of

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
