"""Executors: who makes artifacts. This process, or the tasks of a cluster, each by `worker.py`."""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol

from ..contract import Progress, RaucaError
from ..contract.files import sweep_partials
from ..runtime.cluster import Cluster
from ..runtime.folder_lock import alone_in
from .artifact import Artifact, read_recipe
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

    def run(self, tasks: Sequence[Task], machine: Machine, on_progress: OnProgress) -> Iterator[tuple[str, float]]:
        """Do all; yields the title of each that is done, and the seconds that it took in all."""
        ...


class Here:
    """In this process, one after the other."""

    def run(self, tasks: Sequence[Task], machine: Machine, on_progress: OnProgress) -> Iterator[tuple[str, float]]:
        for task in tasks:
            yield task.title, do_task(task, machine, partial(on_progress, task.title))


class OnCluster:
    """Heavy artifacts by tasks of a cluster, all that do not depend on each other at once; the others here.

    The machines must see the store under the same path.
    """

    def __init__(self, cluster: Cluster) -> None:
        self._cluster = cluster

    def run(self, tasks: Sequence[Task], machine: Machine, on_progress: OnProgress) -> Iterator[tuple[str, float]]:
        yield from Here().run([task for task in tasks if not KINDS[task.kind].heavy], machine, on_progress)
        heavy = [task for task in tasks if KINDS[task.kind].heavy]
        if not heavy:
            return
        for task in heavy:
            _write_recipes(task)
        how = json.dumps(machine.to_json())
        command = [sys.executable, "-m", "rauca_core.study.worker", "--machine", how]
        commands = [[*command, *(str(folder.absolute()) for folder in task.folders)] for task in heavy]
        titles = sorted({KINDS[task.kind].doing for task in heavy})
        report = partial(on_progress, ", ".join(titles))
        began = time.perf_counter()
        failed = self._cluster.run(commands, heavy[0].folders[0].parent.parent / "cluster", report)
        for task, reason in zip(heavy, failed, strict=True):
            if reason:
                others = sum(map(bool, failed)) - 1
                raise RaucaError(f"{task.title}: {reason}" + (f" (and {others} other tasks failed)" if others else ""))
            yield task.title, time.perf_counter() - began


def do_task(task: Task, machine: Machine, report: Callable[[Progress], None]) -> float:
    """Make a task's artifacts in this process; returns the seconds that they took, over all who worked on them.

    Another process that makes one of them is waited for.
    """
    kind = KINDS[task.kind]
    with contextlib.ExitStack() as held:
        for folder in task.folders:
            held.enter_context(alone_in(folder, LOCK, lambda who: report(Progress(0, 1, f"{who} makes it, waiting"))))
        left = [i for i, one in enumerate(task.artifacts) if not kind.complete(one, task.folders[i])]
        if not left:
            return 0.0
        spent = _write_recipes(task)
        began = time.perf_counter()
        try:
            for folder in task.folders:
                sweep_partials(folder)
            kind.make([Job(task.artifacts[i], task.folders[i], task.inputs[i], machine, report) for i in left])
        finally:
            spent += time.perf_counter() - began
            _write_recipes(task, spent)
    return spent


def _write_recipes(task: Task, seconds: float | None = None) -> float:
    """Note what each folder is to hold; returns the seconds that were spent on them before."""
    spent = 0.0
    for artifact, folder, inputs in zip(task.artifacts, task.folders, task.inputs, strict=True):
        known = 0.0
        with contextlib.suppress(RaucaError):
            known = read_recipe(folder)[1]
        artifact.write_recipe(folder, inputs, known if seconds is None else seconds)
        spent = max(spent, known)
    return spent
