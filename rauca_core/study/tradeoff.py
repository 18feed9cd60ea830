"""The price of naturalness: one camouflage per bound and size of patch, all judged on the same held-out views.

Folder, run again to resume::

    points/<label>/        links to the optimizations, as of `rauca optimize`
    study/                 as of `evaluate`
    store/                 all that was made on the way
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..attack import make_settings
from ..attack.naturalness import Naturalness
from ..contract import Dataset
from ..detect import Detector
from ..runtime.folder_lock import alone_in
from . import recipes
from .candidates import read_candidates, read_vehicle_choice
from .engine import Engine
from .evaluate import Judges, held_out_places, judge, keep_paints
from .executors import Executor
from .job import Machine, OnProgress, quiet
from .makers import CAMOUFLAGE
from .measuring import detectors_for
from .store import Store, link, store_around, user_cache
from .study import Study
from .views import HeldOut, weather_sets

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
    """What came of it.

    Attributes:
        study: of all camouflages, labeled by their points.
        camouflages: JSON paths by label.
        attacked: names of the detectors that were optimized against.
        reference: what bounds are about; None without one.
    """

    study: Study
    camouflages: dict[str, Path]
    attacked: tuple[str, ...]
    reference: Naturalness | None


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


def tradeoff(
    dataset: Dataset | Path | str,
    wanted: Sequence[Point],
    out: Path | str,
    *,
    attacked: Sequence[Detector | str] = ("yolov3-tiny",),
    detectors: Sequence[Detector | str] = (),
    weathers: Sequence[str] = ("seen",),
    sizes: Sizes | None = None,
    seed: int = 0,
    threads: int | None = None,
    device: str = "cpu",
    blender: Path | None = None,
    render_device: str = "cpu",
    executor: Executor | None = None,
    on_progress: OnProgress = quiet,
    command: str = "",
) -> TradeOff:
    """Optimize a camouflage for each point and judge all; points differ in what is asked of the paint alone.

    Args:
        dataset: with light maps, to optimize on.
        detectors: to measure with, beside the attacked ones; every one that is ready if there are none.

    Raises:
        RaucaError: as `optimize` and `evaluate` do, before anything is optimized where that can be told.
    """
    data, size, out = dataset if isinstance(dataset, Dataset) else Dataset(Path(dataset)), sizes or Sizes(), Path(out)
    vehicle, sets = read_vehicle_choice(data.vehicle_folder), weather_sets(weathers)
    every = [*attacked, *(detectors or ["all"])]
    chosen = detectors_for(every, [vehicle.category], device, published=True)
    white_boxes = chosen[vehicle.category][: len(attacked)]
    machine = Machine(device, threads, blender, render_device).with_detectors(
        one for _, one in chosen[vehicle.category]
    )
    store = Store(out / "store", [*store_around(data.folder), user_cache()])
    engine = Engine(store, machine, on_progress, executor)
    training = recipes.views_in(data.folder)
    paints = {
        point.label: recipes.paint(
            training,
            make_settings(
                steps=size.steps, batch=size.batch, map_size=size.map_size, seed=seed, samples=size.subsamples,
                checkpoint_every=50, name=point.label, natural=point.natural, target=vehicle.target,
            ),
            [detector for _, detector in white_boxes],
            [typed for typed, _ in white_boxes],
        )
        for point in wanted
    }  # fmt: skip
    with alone_in(out):
        folders = dict(zip(paints, engine.make(*paints.values()), strict=True))
        for label, folder in folders.items():
            link(out / "points" / label, folder)
        made = {label: folder / CAMOUFLAGE for label, folder in folders.items()}
        held_out = HeldOut(size.frames, size=size.size, samples=size.samples)
        candidates = read_candidates([f"{label}={path}" for label, path in made.items()])
        worn = {vehicle: keep_paints(engine, out / "study", vehicle, candidates, None)}
        places = held_out_places([vehicle], sets, held_out)
        study = judge(engine, out / "study", places, worn, Judges(chosen), command)
    reference = next((p.natural for p in wanted if p.natural is not None and p.natural.reference), None)
    return TradeOff(study, made, tuple(detector.name for _, detector in white_boxes), reference)
