"""The main job on one screen: synthesise -> optimize -> apply -> re-render -> measure -> report.

``python pipelines/demo.py`` or ``rauca demo`` runs it; run again to resume.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pipelines.console import console, progress_bar
from pipelines.dataset_options import dataset_job, dataset_parser
from pipelines.evaluate import measure, render_camouflages
from pipelines.going_on import goes_on_by_itself
from pipelines.optimize_camouflage import optimize_camouflage
from pipelines.renderers import AGREEMENT, compare_renderers
from pipelines.report import report_run
from pipelines.stages import Stages
from rauca_core.attack import make_settings, random_camouflage
from rauca_core.attack.methods import settings_of
from rauca_core.contract import RenderCamouflages, load_vehicle
from rauca_core.contract.files import file_digest
from rauca_core.detect import fetch
from rauca_core.runtime.blender import run_blender
from rauca_core.runtime.images import read_image
from rauca_core.study.contestants import read_vehicle_choice

WHITE_BOX = "yolov3-tiny"
BLACK_BOX = ("yolov4-tiny", "yolov2-tiny")
SEED = 1
RANDOM_CELL = 8  # texels; finer noise averages to grey at these distances and would be a weaker rival


@dataclass(frozen=True)
class DemoScale:
    """How much the demo renders and optimizes; the default fits two cores and half an hour.

    The strings are arguments of ``rauca dataset make``. The held-out views are in another town, from other cameras.

    Attributes:
        method: one of `attack.methods`.
    """

    frames: str = "--weathers demo --size 320 --samples 8"
    train: str = (
        "--locations 4 --azimuths 4 --elevations 6,20 --distances 7 "
        "--jitter-azimuth 45 --jitter-elevation 6 --jitter-distance 0.3 --jitter-aim 0.3"
    )
    held_out: str = (
        "--locations 1 --azimuths 6 --elevations 6,20 --distances 6,8 "
        "--jitter-azimuth 10 --jitter-elevation 5 --jitter-distance 0.1 --jitter-aim 0.3"
    )
    method: str = "ours"
    steps: int = 600
    batch: int = 4


@dataclass(frozen=True)
class DemoChoice:
    """Where the demo writes and what it works on; ``vehicle`` holds the vehicle's arguments as given."""

    out: Path
    vehicle: Sequence[str]
    blender: Path | None = None
    scale: DemoScale = field(default_factory=DemoScale)


@goes_on_by_itself()
def run_demo(choice: DemoChoice) -> Path:
    """Run or resume the demo; returns the report's path."""
    out, scale, stages = choice.out, choice.scale, Stages(choice.out)
    train, held_out, renders = out / "train", out / "held-out", out / "renders"
    random, rauca = out / "random" / "camouflage.json", out / "rauca" / "camouflage.json"
    detectors, held_out_views = (WHITE_BOX, *BLACK_BOX), f"{scale.held_out} --no-light"

    def dataset(folder: Path, title: str, vehicle: Sequence[str], options: str, seed: int) -> None:
        chosen = f"{scale.frames} {options} --seed {seed}".split()
        arguments = ["--out", str(folder), *vehicle, *chosen]

        def work() -> None:
            job = dataset_job(dataset_parser().parse_args(arguments))
            with progress_bar(title) as move:
                run_blender(job, move, choice.blender)

        stages.run(title, arguments, work, folder / "dataset.json")

    def optimize() -> None:
        size = {"steps": scale.steps, "batch": scale.batch, "seed": SEED, "checkpoint_every": 50}
        settings = make_settings(**settings_of(scale.method, **size, target=target, name="rauca"))
        started = (rauca.parent / "checkpoints").is_dir()
        optimize_camouflage(train, [WHITE_BOX], settings, rauca.parent, resume=started)

    def paint_random() -> None:
        loaded = load_vehicle(train / "vehicle", read_image)
        random_camouflage(random, loaded, seed=SEED, cell=RANDOM_CELL)

    stages.run("fetching weights", detectors, lambda: [fetch(name) for name in detectors], out)
    dataset(train, "rendering training set", choice.vehicle, scale.train, SEED)
    dataset(held_out, "rendering held-out views", ["--vehicle", str(train / "vehicle")], held_out_views, SEED + 1)
    target = read_vehicle_choice(train / "vehicle").target
    stages.run("optimizing", [scale.method, scale.steps, scale.batch, SEED, target], optimize, rauca)
    stages.run("random paint", [SEED, RANDOM_CELL], paint_random, random)
    both = [random, rauca]
    painted = [file_digest(path.with_suffix(".png")) for path in both]
    job = RenderCamouflages(held_out, renders, tuple(both))
    stages.run("re-rendering", painted, lambda: render_camouflages(job, choice.blender), renders)
    results, agree = out / "results.json", out / AGREEMENT
    asked = [*detectors, target, *painted]
    stages.run("detecting", asked, lambda: measure(held_out, both, renders, detectors, out, target), results)
    stages.run("comparing renderers", painted, lambda: compare_renderers(train, rauca, out, choice.blender), agree)
    report = report_run(out)
    console.print(f"report: {report}")
    return report


if __name__ == "__main__":
    from pipelines.cli import run

    run("demo")
