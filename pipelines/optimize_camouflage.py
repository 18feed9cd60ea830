"""Optimise a camouflage on a data set against a detector.

``python pipelines/optimize_camouflage.py --help`` or ``rauca optimize --help`` lists the options;
``torchrun --nproc-per-node N pipelines/optimize_camouflage.py ...`` shares every step between N processes.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from pipelines.console import console, progress_bar
from rauca_core.attack import OptimiserSettings, StepReport, optimise
from rauca_core.contract import Dataset, Progress
from rauca_core.detect import load_detector
from rauca_core.environment.distributed import team


def optimize_camouflage(
    dataset: Path, detectors: Sequence[str], settings: OptimiserSettings, out: Path, resume: bool
) -> Path:
    """Optimise with a progress bar; returns the camouflage's JSON."""
    console.quiet = os.environ.get("RANK", "0") != "0"  # one process of several speaks
    with progress_bar("optimising") as move:
        views = ""

        def show(report: StepReport) -> None:
            move(Progress(report.step, report.steps, f"loss {report.loss:.3f}  score {report.score:.2f}{views}"))

        def show_views(done: int, total: int) -> None:
            nonlocal views
            views = f"  views {done}/{total}" if done < total else ""

        loaded = [load_detector(name, settings.detector_size) for name in detectors]
        with team() as processes:
            return optimise(Dataset(dataset), loaded, settings, out, show, resume, show_views, processes)


if __name__ == "__main__":
    from pipelines.cli import run

    run("optimize")
