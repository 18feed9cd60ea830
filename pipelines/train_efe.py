"""Train our environment feature extractor.

``python pipelines/train_efe.py DATASETS --out FOLDER`` or ``rauca efe train`` runs it in one process,
``torchrun --nproc-per-node N pipelines/train_efe.py DATASETS --out FOLDER`` in N.
"""

from __future__ import annotations

import os
import shlex
import sys
from pathlib import Path

from pipelines.console import console, progress_bar
from rauca_core.contract import Progress
from rauca_core.training.extractor import EpochReport
from rauca_core.training.extractor_fit import Fit, fit


def train_efe(wanted: Fit, resume: bool) -> Path:
    """Train with a progress bar; returns the weights' path."""
    said = ""
    console.quiet = os.environ.get("RANK", "0") != "0"  # one process of several speaks
    with progress_bar("training") as move:

        def show_step(done: int, steps: int) -> None:
            move(Progress(done, steps, said))

        def show_epoch(report: EpochReport) -> None:
            nonlocal said
            said = f"epoch {report.epoch}/{report.epochs}  error {report.error:.4f}  best {report.best:.4f}"
            if not console.is_terminal:
                console.print(said)

        weights, outcome = fit(wanted, resume, show_epoch, show_step)
    ended = f"converged at epoch {outcome.converged}" if outcome.converged else f"{len(outcome.errors) - 1} epochs"
    console.print(f"{ended}; best at {outcome.best_epoch}, mean absolute error {min(outcome.errors):.4f}")
    return weights


def command_line(command: str) -> str:
    """What the user typed after ``rauca efe``, paths by their last names: machines differ."""
    words = sys.argv[3:] if sys.argv[1:3] == ["efe", command] else sys.argv[1:]
    return shlex.join(["rauca", "efe", command, *(Path(word).name if "/" in word else word for word in words)])


if __name__ == "__main__":
    from pipelines.cli import run

    run("efe", "train")
