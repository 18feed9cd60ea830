"""The price of naturalness: one camouflage per bound and size of patch, all judged on the same held-out views.

Folder, run again to resume::

    points/<label>/        each optimization, as of `rauca optimize`
    study/                 views, renders in every camouflage and results, as of `rauca evaluate`
    tradeoff.html, .json, .csv
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from pipelines.console import console
from pipelines.going_on import goes_on_by_itself
from pipelines.optimize_camouflage import optimize_camouflage
from pipelines.protocol import Request, run_study
from rauca_core.attack import OptimizerSettings, make_settings
from rauca_core.attack.naturalness import Naturalness
from rauca_core.attack.optimizer import unlike
from rauca_core.contract import Dataset, RaucaError
from rauca_core.detect import Detector, load_detector
from rauca_core.report import Curve, measure_points, write_curve
from rauca_core.runtime.checkpoint_files import POINTER
from rauca_core.study.contestants import VehicleChoice, read_contestants, read_vehicle_choice
from rauca_core.study.defences import make_defence
from rauca_core.study.measure import check_detectors
from rauca_core.study.views import HeldOut

FREE = "free"


@dataclass(frozen=True)
class Sizes:
    """How much work: ``steps`` of ``batch`` frames per camouflage; ``frames`` of ``size`` pixels per weather set.

    Attributes:
        subsamples: of the neural renderer, per pixel and axis; ``samples`` are Cycles', per pixel.
    """

    steps: int = 400
    batch: int = 4
    map_size: int = 512
    subsamples: int = 12
    frames: int = 64
    size: int = 320
    samples: int = 8

    def but(self, **chosen: int | None) -> Sizes:
        """The same, with what was chosen."""
        return replace(self, **{name: value for name, value in chosen.items() if value is not None})


QUICK = Sizes(steps=24, batch=2, map_size=256, subsamples=4, frames=8, size=160, samples=2)


@dataclass(frozen=True)
class Point:
    """One camouflage of the curve; ``natural`` is None where the paint is free."""

    label: str
    natural: Naturalness | None


@dataclass(frozen=True)
class TradeOff:
    """What is asked for; everything in it was checked.

    Attributes:
        attacked, measured: detectors, as typed; the attacked come first among the measured.
        weathers: of the held-out views, as `rauca evaluate` takes them.
    """

    command: str
    dataset: Dataset
    out: Path
    points: tuple[Point, ...]
    attacked: tuple[str, ...]
    measured: tuple[str, ...]
    weathers: tuple[str, ...]
    sizes: Sizes
    seed: int = 0
    threads: int | None = None
    blender: Path | None = None

    @cached_property
    def vehicle(self) -> VehicleChoice:
        """The data set's."""
        return read_vehicle_choice(self.dataset.vehicle_folder)

    def settings(self, point: Point) -> OptimizerSettings:
        """The optimizer's, for one point; all points differ in what is asked of the paint alone."""
        sizes = self.sizes
        return make_settings(
            steps=sizes.steps, batch=sizes.batch, map_size=sizes.map_size, seed=self.seed, threads=self.threads,
            samples=sizes.subsamples, checkpoint_every=50, name=point.label, natural=point.natural,
            target=self.vehicle.target,
        )  # fmt: skip


def points(base: Naturalness | None, bounds: Sequence[float], features: Sequence[float]) -> tuple[Point, ...]:
    """The free camouflage, then one per bound and one per size of patch, cm.

    Args:
        base: what is asked of every point, such as a palette; its reference is what bounds are about.
    """
    shared = base or Naturalness()
    nowhere = shared.model_copy(update={"reference": None, "reference_sha256": None})

    def asked(wanted: Naturalness, **more: float) -> Naturalness:
        return Naturalness(**{**wanted.model_dump(), **more})

    return (
        Point(FREE, None if nowhere.empty else nowhere),
        *(Point(f"dE-{bound:g}", asked(shared, max_delta_e=bound)) for bound in bounds),
        *(Point(f"patch-{size:g}cm", asked(nowhere, feature_cm=size)) for size in features),
    )


@goes_on_by_itself()
def run_tradeoff(asked: TradeOff) -> Path:
    """Run or resume; returns the path of the page.

    Raises:
        RaucaError: as `rauca optimize` and `rauca evaluate` do, before anything is optimized where that can be told.
    """
    vehicle = asked.vehicle
    loaded = [load_detector(name) for name in asked.measured]
    check_detectors(loaded, vehicle.category)
    attacked = loaded[: len(asked.attacked)]
    made = {point.label: _camouflage(asked, point, attacked) for point in asked.points}
    request = Request(
        command=asked.command,
        out=asked.out / "study",
        contestants={vehicle: read_contestants(f"{label}={path}" for label, path in made.items())},
        detectors={vehicle.category: loaded},
        defences=[make_defence("none")],
        weathers=asked.weathers,
        held_out=HeldOut(asked.sizes.frames, size=asked.sizes.size, samples=asked.sizes.samples),
        blender=asked.blender,
    )
    entries = run_study(request)
    reference = next((p.natural for p in asked.points if p.natural is not None and p.natural.reference), None)
    measured = measure_points(made, asked.dataset.vehicle_folder, reference)
    names = tuple(detector.name for detector in attacked)
    curve = Curve(asked.command, names, reference, measured, tuple(entries))
    return write_curve(curve, asked.out / "tradeoff.html")[0]


def _camouflage(asked: TradeOff, point: Point, attacked: Sequence[Detector]) -> Path:
    """A point's camouflage, optimized or gone on with where it is not there yet."""
    folder, settings = asked.out / "points" / point.label, asked.settings(point)
    path = folder / "camouflage.json"
    if path.is_file():
        if other := unlike(asked.dataset, attacked, settings, folder):
            raise RaucaError(f"{folder}: made with another {', '.join(other)}; choose another --out, or remove it")
        return path
    console.print(f"{point.label}: {settings.steps} steps", highlight=False)
    resume = (folder / "checkpoints" / POINTER).is_file()
    return optimize_camouflage(asked.dataset.folder, asked.attacked, settings, folder, resume)
