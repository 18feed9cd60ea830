"""Optimize a camouflage on a data set against a detector.

``python pipelines/optimize_camouflage.py --help`` or ``rauca optimize --help`` lists the options;
``torchrun --nproc-per-node N pipelines/optimize_camouflage.py ...`` shares every step between N processes.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median

from pipelines.console import console, progress_bar
from rauca_core.attack import OptimizerSettings, StepReport, run_optimization
from rauca_core.attack.history import PICTURE, UV_MAP
from rauca_core.contract import Dataset, OptimizeProgress, Progress
from rauca_core.detect import load_detector
from rauca_core.runtime.distributed import joined_processes

RECENT_STEPS = 50  # that the time left is judged by


def optimize_camouflage(
    dataset: Path,
    detectors: Sequence[str],
    settings: OptimizerSettings,
    out: Path,
    resume: bool,
    json_progress: bool = False,
    device: str | None = None,
) -> Path:
    """Optimize with a progress bar, and lines for another program if asked; returns the camouflage's JSON."""
    console.quiet = os.environ.get("RANK", "0") != "0"  # one process of several speaks
    tell = _lines(out) if json_progress else None
    with progress_bar("optimizing") as move:
        views = ""

        def show(report: StepReport) -> None:
            move(Progress(report.step, report.steps, f"loss {report.loss:.3f}  score {report.score:.2f}{views}"))
            if tell is not None:
                tell(report)

        def show_views(done: int, total: int) -> None:
            nonlocal views
            views = f"  views {done}/{total}" if done < total else ""

        loaded = [load_detector(name, settings.detector_size) for name in detectors]
        with joined_processes(device) as processes:
            return run_optimization(Dataset(dataset), loaded, settings, out, show, resume, show_views, processes)


def _lines(out: Path) -> Callable[[StepReport], None]:
    """Prints each step as a line of JSON on standard output; once nobody reads it any more, the run goes on alone."""
    recent: deque[float] = deque(maxlen=RECENT_STEPS)
    pictures = str((out / PICTURE).absolute()), str((out / UV_MAP).absolute())
    heard = True

    def tell(report: StepReport) -> None:
        nonlocal heard
        recent.append(report.seconds)
        left_s = (report.steps - report.step) * median(recent)
        losses = report.loss, report.attack, report.smooth, report.score
        line = OptimizeProgress(report.step, report.steps, *losses, report.seconds, left_s, *pictures).line() + "\n"
        try:
            if heard:
                os.write(1, line.encode())  # one write, whole lines: nothing is left to be flushed when we end
        except BrokenPipeError:
            heard = False

    return tell


if __name__ == "__main__":
    from pipelines.cli import run

    run("optimize")
