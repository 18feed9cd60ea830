"""The engine: makes the artifacts that a study wants and does not find, in the order of their inputs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypedDict

from ..contract import RaucaError
from .artifact import Artifact, seconds_spent
from .executors import Executor, Here, Task, sweep_finished
from .job import Machine, OnProgress, quiet
from .makers import KINDS
from .store import Store, store_around, user_cache


class Means(TypedDict, total=False):
    """With what a study is made, which changes none of its numbers; every study takes these by keyword.

    Attributes:
        device: of torch, for all that runs on it: cpu (the default), cuda, cuda:1, mps ...
        threads: of torch; its own choice if left out.
        blender: program; the bpy wheel if left out.
        render_device: of Cycles: cpu (the default), gpu, or auto, which is a GPU where there is one.
        executor: who makes artifacts; this process if left out.
        on_progress: called with what is being done, and how far it is.
    """

    device: str
    threads: int | None
    blender: Path | None
    render_device: str
    executor: Executor | None
    on_progress: OnProgress


class Engine:
    """Makes artifacts in a store.

    Attributes:
        made: how many of each kind this engine has made, or gone on with.
        seconds: that making took, of all that was asked for, by what was done and whenever that was.
    """

    def __init__(
        self,
        store: Store,
        machine: Machine | None = None,
        on_progress: OnProgress = quiet,
        executor: Executor | None = None,
    ) -> None:
        self.store, self.machine, self.on_progress = store, machine or Machine(), on_progress
        self._executor = executor or Here()
        self.made: Counter[str] = Counter()
        self.seconds: dict[str, float] = {}
        self._finished: dict[str, Path] = {}

    def make(self, *wanted: Artifact) -> tuple[Path, ...]:
        """The folders of artifacts, made where they are not finished; what they are made from comes first.

        Raises:
            RaucaError: an artifact cannot be made. What was made before stays, and the next call goes on from there.
        """
        for level in self._levels(wanted):
            tasks = [self._task(group) for group in _groups(level)]
            for task in tasks:
                self.made.update(job.kind for job in task.artifacts)
            self._executor.run(tasks, self.machine, self.on_progress)
        return tuple(map(self._folder, wanted))

    def make_named(self, wanted: Mapping[str, Artifact]) -> dict[str, Path]:
        """The same, by name."""
        return dict(zip(wanted, self.make(*wanted.values()), strict=True))

    def _levels(self, wanted: Sequence[Artifact]) -> Iterator[list[Artifact]]:
        """What is to be made, each level from nothing but earlier ones; a finished artifact needs no inputs."""
        missing: dict[str, Artifact] = {}
        depth: dict[str, int] = {}

        def look(artifact: Artifact) -> int:
            key = f"{artifact.kind}/{artifact.digest}"
            if key not in depth:
                if self._find(artifact) is not None:
                    depth[key] = 0
                else:
                    missing[key] = artifact
                    depth[key] = 1 + max(map(look, artifact.inputs), default=0)
            return depth[key]

        deepest = max(map(look, wanted), default=0)
        for level in range(1, deepest + 1):
            yield [artifact for key, artifact in missing.items() if depth[key] == level]

    def _task(self, group: list[Artifact]) -> Task:
        inputs = [tuple(map(self._folder, artifact.inputs)) for artifact in group]
        return Task(tuple(group), tuple(self.store.place(a) for a in group), tuple(inputs))

    def _find(self, artifact: Artifact) -> Path | None:
        """The folder of a finished artifact; it is looked at once, as its files are many."""
        key = f"{artifact.kind}/{artifact.digest}/{artifact.options}"
        if key not in self._finished and (found := self.store.find(artifact)) is not None:
            self._finished[key] = found
            if artifact.place is None and found.parent.parent == self.store.folder:
                sweep_finished(found)
            self._count_seconds(artifact, found)
        return self._finished.get(key)

    def _count_seconds(self, artifact: Artifact, folder: Path) -> None:
        kind = KINDS.get(artifact.kind)
        if kind is not None and artifact.place is None:
            many = artifact.kind in ("renders", "composed", "defended", "detections")
            title = kind.doing if many else f"{kind.doing}, {artifact.label}"
            self.seconds[title] = round(self.seconds.get(title, 0.0) + seconds_spent(folder), 2)

    def _folder(self, artifact: Artifact) -> Path:
        found = self._find(artifact)
        if found is None:
            raise RaucaError(
                f"{self.store.place(artifact)}: its maker ended and it is not whole; run the command again"
            )
        return found


def open_engine(
    store: Path,
    around: Iterable[Path] = (),
    *,
    device: str = "cpu",
    threads: int | None = None,
    blender: Path | None = None,
    render_device: str = "cpu",
    executor: Executor | None = None,
    on_progress: OnProgress = quiet,
) -> Engine:
    """An engine that makes artifacts in a store, and looks into those around some paths and into the user's cache;
    :class:`Means` says what the others are."""
    parents = [place for path in around for place in store_around(path)]
    machine = Machine(device, threads, blender, render_device)
    return Engine(Store(store, [*parents, user_cache()]), machine, on_progress, executor)


def _groups(artifacts: Sequence[Artifact]) -> list[list[Artifact]]:
    """Those that are made together, in the order given."""
    groups: dict[object, list[Artifact]] = {}
    for artifact in artifacts:
        groups.setdefault((artifact.kind, KINDS[artifact.kind].group(artifact)), []).append(artifact)
    return list(groups.values())
