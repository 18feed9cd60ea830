"""Executors: who makes artifacts. This process, or the tasks of a cluster, each by `worker.py`."""

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
from ..contract.files import sweep_partials
from ..runtime.cluster import Cluster
from ..runtime.folder_lock import alone_in
from .artifact import Artifact, seconds_spent
from .job import Job, Machine, OnProgress
from .kinds import KINDS

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
            _write_recipes(task, _seconds(task))
        command = [sys.executable, "-m", "rauca_core.study.worker", "--machine", json.dumps(machine.to_json())]
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
        left = [i for i, one in enumerate(task.artifacts) if not kind.complete(one, task.folders[i])]
        if not left:
            return
        spent = _seconds(task)
        _write_recipes(task, spent)
        began = time.perf_counter()
        try:
            for folder in task.folders:
                sweep_partials(folder)
            kind.make([Job(task.artifacts[i], task.folders[i], task.inputs[i], machine, report) for i in left])
        finally:
            more = (time.perf_counter() - began) / len(left)
            _write_recipes(task, [s + more * (i in left) for i, s in enumerate(spent)])


def _write_recipes(task: Task, seconds: Sequence[float]) -> None:
    """Note what each folder is to hold, and the time that was spent on it."""
    for artifact, folder, inputs, spent in zip(task.artifacts, task.folders, task.inputs, seconds, strict=True):
        artifact.write_recipe(folder, inputs, spent)


def _seconds(task: Task) -> list[float]:
    """Spent on each artifact before."""
    return [seconds_spent(folder) for folder in task.folders]
