"""What a maker of artifacts is handed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..attack import StepReport
from ..contract import Progress, RaucaError
from ..detect import Detector, load_detector
from ..runtime.devices import find_device
from ..runtime.distributed import Processes
from .artifact import Artifact

OnProgress = Callable[[str, Progress], None]
"""Called with what is being done, and how far it is; the only way in which a study speaks while it works."""


def quiet(title: str, progress: Progress) -> None:
    """For who does not want to know."""


@dataclass(frozen=True)
class Machine:
    """With what artifacts are made; what is made does not depend on it.

    Attributes:
        device: of torch, for all that runs on it.
        threads: of torch; None for its own choice.
        blender: program; None for the bpy wheel.
        render_device: of Cycles: ``cpu``, ``gpu``, or ``auto``, which is a GPU where there is one.
        loaded: detectors at hand, by fingerprint.
    """

    device: str = "cpu"
    threads: int | None = None
    blender: Path | None = None
    render_device: str = "cpu"
    loaded: dict[str, Detector] = field(default_factory=dict)

    @property
    def processes(self) -> Processes:
        """One process, on the device."""
        return Processes(0, 1, find_device(self.device))

    def detector(self, fingerprint: str, typed: str) -> Detector:
        """A detector on this machine's device, loaded by what was typed to name it unless it is at hand.

        Raises:
            RaucaError: it cannot be loaded, or is another one by now.
        """
        if fingerprint not in self.loaded:
            found = load_detector(typed, device=self.device)
            if found.fingerprint != fingerprint:
                raise RaucaError(f"{typed}: its weights have changed since the work began; run the command again")
            self.loaded[fingerprint] = found
        return self.loaded[fingerprint].to(self.device)

    def to_json(self) -> dict[str, Any]:
        """For another process, which loads its own detectors."""
        own = {"device": self.device, "threads": self.threads, "render_device": self.render_device}
        return own | {"blender": None if self.blender is None else str(self.blender)}

    @staticmethod
    def from_json(fields: dict[str, Any]) -> Machine:
        return Machine(**{**fields, "blender": Path(fields["blender"]) if fields["blender"] else None})


@dataclass(frozen=True)
class Job:
    """One artifact to be made, from the beginning or from where an earlier process stopped.

    Attributes:
        folder: to make it in.
        inputs: the folders of its inputs, in order.
        report: tells how far the work is; shared by jobs that are done together.
    """

    artifact: Artifact
    folder: Path
    inputs: tuple[Path, ...]
    machine: Machine
    report: Callable[[Progress], None]


def steps_told(report: Callable[[Progress], None]) -> tuple[Callable[[StepReport], None], Callable[[int, int], None]]:
    """What an optimization calls after every step, and while it makes views ready, so that its progress is told."""
    views = ""

    def step(one: StepReport) -> None:
        report(Progress(one.step, one.steps, f"loss {one.loss:.3f}  score {one.score:.2f}{views}"))

    def view(done: int, total: int) -> None:
        nonlocal views
        views = f"  views {done}/{total}" if done < total else ""

    return step, view
