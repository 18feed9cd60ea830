"""Executors: who makes artifacts. This process, or the tasks of a cluster.

Such a task is ``python -m rauca_core.study.executors MACHINE FOLDER...``: it makes what the recipes in the folders
describe, tells progress as lines on standard output, and a mistake as one line on standard error with exit code 2.
"""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol

from ..contract import Progress, RaucaError
from ..contract.files import TEMPORARY_PREFIX, sweep_partials
from ..runtime.cluster import Cluster
from ..runtime.folder_lock import alone_in
from ..runtime.stopping import take_sigterm_for_ctrl_c
from .artifact import Artifact, read_recipe, seconds_spent
from .job import Job, Machine, OnProgress
from .makers import KINDS

LOCK = ".making"


@dataclass(frozen=True)
class Task:
    """Artifacts of one kind that are made together, where, and the folders of their inputs."""

    artifacts: tuple[Artifact, ...]
    folders: tuple[Path, ...]
    inputs: tuple[tuple[Path, ...], ...]

    @property
    def kind(self) -> str:
        return self.artifacts[0].kind

    @property
    def title(self) -> str:
        """What is said while it is done."""
        several = len(self.artifacts)
        return f"{KINDS[self.kind].doing}, {self.artifacts[0].label if several == 1 else f'{several} together'}"

    def seconds(self) -> list[float]:
        """Spent on each artifact before."""
        return [seconds_spent(folder) for folder in self.folders]

    def write_recipes(self, seconds: Sequence[float]) -> None:
        """Note what each folder is to hold, and the time that was spent on it."""
        for artifact, folder, inputs, spent in zip(self.artifacts, self.folders, self.inputs, seconds, strict=True):
            artifact.write_recipe(folder, inputs, spent)


class Executor(Protocol):
    """Does tasks that do not depend on each other."""

    def run(self, tasks: Sequence[Task], machine: Machine, on_progress: OnProgress) -> None:
        """Do all of them."""
        ...


class Here:
    """In this process, one after the other."""

    def run(self, tasks: Sequence[Task], machine: Machine, on_progress: OnProgress) -> None:
        for task in tasks:
            do_task(task, machine, partial(on_progress, task.title))


class OnCluster:
    """Heavy artifacts by tasks of a cluster, all that do not depend on each other at once; the others here.

    The machines must see the store under the same path.
    """

    def __init__(self, cluster: Cluster) -> None:
        self._cluster = cluster

    def run(self, tasks: Sequence[Task], machine: Machine, on_progress: OnProgress) -> None:
        Here().run([task for task in tasks if not KINDS[task.kind].heavy], machine, on_progress)
        heavy = [task for task in tasks if KINDS[task.kind].heavy]
        if not heavy:
            return
        for task in heavy:
            task.write_recipes(task.seconds())
        command = [sys.executable, "-m", "rauca_core.study.executors", json.dumps(machine.to_json())]
        commands = [[*command, *(str(folder.absolute()) for folder in task.folders)] for task in heavy]
        titles = sorted({KINDS[task.kind].doing for task in heavy})
        logs = heavy[0].folders[0].parent.parent / "cluster"
        failed = self._cluster.run(commands, logs, partial(on_progress, ", ".join(titles)))
        for task, reason in zip(heavy, failed, strict=True):
            if reason:
                others = sum(map(bool, failed)) - 1
                raise RaucaError(f"{task.title}: {reason}" + (f" (and {others} other tasks failed)" if others else ""))


def do_task(task: Task, machine: Machine, report: Callable[[Progress], None]) -> None:
    """Make a task's artifacts in this process; another process that makes one of them is waited for."""
    kind = KINDS[task.kind]
    with contextlib.ExitStack() as held:
        for folder in task.folders:
            held.enter_context(alone_in(folder, LOCK, lambda who: report(Progress(0, 1, f"{who} makes it, waiting"))))
        left = [i for i, one in enumerate(task.artifacts) if not kind.has(one, task.folders[i])]
        if not left:
            return
        spent = task.seconds()
        task.write_recipes(spent)
        began = time.perf_counter()
        try:
            for folder in task.folders:
                sweep_partials(folder)
            kind.make(*(Job(task.artifacts[i], task.folders[i], task.inputs[i], machine, report) for i in left))
        finally:
            more = (time.perf_counter() - began) / len(left)
            task.write_recipes([s + more * (i in left) for i, s in enumerate(spent)])


def sweep_finished(folder: Path) -> None:
    """Remove what a maker left that was killed when its artifact was whole, as it noted how long that took."""
    if any(folder.glob(TEMPORARY_PREFIX + "*")):
        with alone_in(folder, LOCK, lambda who: None):
            sweep_partials(folder)


def main(machine: str, *folders: str) -> int:
    """Make the artifacts of folders whose inputs are finished; returns the exit code."""
    take_sigterm_for_ctrl_c()
    try:
        artifacts = tuple(read_recipe(Path(folder))[0] for folder in folders)
        inputs = tuple(tuple(one.place for one in artifact.inputs if one.place) for artifact in artifacts)
        task = Task(artifacts, tuple(map(Path, folders)), inputs)
        do_task(task, Machine.from_json(json.loads(machine)), lambda progress: print(progress.line(), flush=True))
    except RaucaError as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        return 2
    except KeyboardInterrupt:
        print("interrupted: what was finished is kept", file=sys.stderr, flush=True)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
