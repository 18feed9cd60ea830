"""Train a detector of our own: ``rauca detectors train``."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipelines.console import console, progress_bar
from rauca_core.contract import Progress
from rauca_core.detect.synth.networks import find_recipe
from rauca_core.study.average_precision import Sample, average_precision
from rauca_core.training.fit import Fit, fit
from rauca_core.training.loop import RoundReport
from rauca_core.training.measure import ALL, Findings, Judged
from rauca_core.training.settings import make_detector_settings


def score(judged: Sequence[Judged]) -> float:
    """AP@0.5 as the evaluation computes it."""
    return average_precision([Sample(one.truth, one.boxes, one.scores) for one in judged])


@dataclass(frozen=True)
class Wish:
    """What the user typed; ``settings`` as of ``DetectorSettings``, None for what was left out."""

    name: str
    datasets: list[Path]
    out: Path
    tests: list[Path]
    settings: dict[str, Any]
    start: Path | None = None
    classes: str = ""
    remarks: str = ""
    device: str = "cpu"


def train_detector(wish: Wish, resume: bool) -> tuple[Path, Findings]:
    """Train with a progress bar; returns the weights' path and the last test."""
    given = {name: value for name, value in wish.settings.items() if value is not None}
    settings = make_detector_settings(**{"lr": find_recipe(wish.name).lr, **given})
    classes = [name.strip() for name in wish.classes.split(",") if name.strip()]
    wanted = Fit(
        wish.name, wish.datasets, wish.out, settings, score, wish.tests, wish.start, classes, command_line(),
        wish.remarks, wish.device,
    )  # fmt: skip
    said = ""
    with progress_bar("training") as move:

        def show_step(done: int, steps: int, loss: float) -> None:
            move(Progress(done, steps, f"loss {loss:.3f}  {said}"))

        def show_round(report: RoundReport[Findings]) -> None:
            nonlocal said
            said = f"AP@0.5 {report.findings.ap50[ALL]:.3f}"
            if not console.is_terminal:
                console.print(f"step {report.step}/{report.steps}  loss {report.loss:.3f}  {said}")

        return fit(wanted, resume, show_round, show_step)


def command_line() -> str:
    """What the user typed, paths by their last names: machines differ."""
    return shlex.join(["rauca", *(Path(word).name if "/" in word else word for word in sys.argv[1:])])
