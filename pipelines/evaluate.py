"""Measure AP@0.5 of detectors on paints: re-render in Blender, detect, report.

``python pipelines/evaluate.py --help`` or ``rauca evaluate --help`` lists the options.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from pipelines.console import progress_bar
from rauca_core.contract import Dataset, Progress, RenderCamouflages, load_camouflage
from rauca_core.detect import load_detector
from rauca_core.runtime.blender import run_blender
from rauca_core.study import DetectionSettings, Results, reference_images
from rauca_core.study import measure as measure_views
from rauca_core.study.contestants import NORMAL
from rauca_core.study.images_of import ImageOf


def render_camouflages(
    job: RenderCamouflages, blender: Path | None = None, title: str = "re-rendering in camouflage"
) -> None:
    """Render a data set's views in camouflages, with Cycles, never with the neural renderer."""
    with progress_bar(title) as move:
        run_blender(job, move, blender)


def measure(
    dataset: Path,
    camouflages: Sequence[Path],
    renders: Path,
    detectors: Sequence[str],
    out: Path,
    category: str = "car",
    size: int | None = None,
) -> Results:
    """Detect in the renders and write ``out/results.json``.

    Args:
        category: the class that detectors are asked for.
        size: of the detectors' square input, pixels; their own by default.
    """
    opened = Dataset(dataset)
    paints: Mapping[str, Path | ImageOf] = {
        NORMAL: reference_images(opened),
        **{name: renders / name for name in (load_camouflage(path)[0].name for path in camouflages)},
    }
    loaded = [load_detector(name, size) for name in detectors]
    with progress_bar("detecting") as move:
        return measure_views(
            opened,
            paints,
            loaded,
            out,
            on_progress=lambda what, done, total: move(Progress(done, total, what)),
            settings=DetectionSettings(category),
        )


if __name__ == "__main__":
    from pipelines.cli import run

    run("evaluate")
