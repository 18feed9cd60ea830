"""Optimise a camouflage on a data set against a detector.

``python pipelines/optimize_camouflage.py --help`` or ``rauca optimize --help`` lists the options.
"""

from __future__ import annotations

from pathlib import Path

from pipelines.console import progress_bar
from rauca_core.attack import OptimiserSettings, StepReport, optimise
from rauca_core.contract import Dataset, Progress
from rauca_core.detect import load_detector


def optimize_camouflage(dataset: Path, detector: str, settings: OptimiserSettings, out: Path, resume: bool) -> Path:
    """Optimise with a progress bar; returns the camouflage's JSON."""
    with progress_bar("optimising") as move:
        views = ""

        def show(report: StepReport) -> None:
            move(Progress(report.step, report.steps, f"loss {report.loss:.3f}  score {report.score:.2f}{views}"))

        def show_views(done: int, total: int) -> None:
            nonlocal views
            views = f"  views {done}/{total}" if done < total else ""

        size = settings.detector_size or 416
        return optimise(Dataset(dataset), load_detector(detector, size), settings, out, show, resume, show_views)


if __name__ == "__main__":
    from pipelines.cli import run

    run("optimize")
