"""The price of naturalness: one camouflage per bound and size of patch, all judged on the same held-out views.

Folder, run again to resume::

    points/<label>/        links to the optimizations, as of `rauca optimize`
    study/                 as of `evaluate`
    store/                 all that was made on the way
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Unpack

from ..attack import make_settings
from ..attack.naturalness import Naturalness
from ..attack.naturalness.granulometry import measure_patches
from ..attack.naturalness.reference import Distance, distance_of_map
from ..contract import Dataset, Vehicle, load_camouflage, load_vehicle
from ..detect import Detector
from ..runtime.folder_lock import alone_in
from ..runtime.images import read_image
from . import recipes
from .candidates import read_vehicle_choice
from .detectors import detectors_for
from .engine import Means, open_engine
from .evaluate import held_out_places, keep_paints
from .judging import Judges, judge
from .makers import CAMOUFLAGE
from .store import link
from .study import Study
from .views import HeldOut, weather_sets

FREE = "free"
FINEST_CUBE_M = 0.01


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


QUICK = Sizes(steps=24, batch=2, map_size=256, subsamples=4, frames=8, size=160, samples=2)


@dataclass(frozen=True)
class Measured:
    """What a camouflage of the curve is, whoever looks at it.

    Attributes:
        bound: on its distance from the reference, None for none; ``feature_cm``: asked for, None for none.
        distance: found, None without a reference.
        smallest_cm, median_cm: sizes of patches found on the vehicle, None where none were asked for.
        losses: means over the last steps of the optimization, as in ``camouflage.json``.
    """

    label: str
    bound: float | None
    feature_cm: float | None
    distance: Distance | None
    smallest_cm: float | None
    median_cm: float | None
    losses: dict[str, float]


@dataclass(frozen=True)
class TradeOff:
    """What came of it.

    Attributes:
        study: of all camouflages, labeled by their points.
        camouflages: JSON paths by label; ``points``: what they are.
        attacked: names of the detectors that were optimized against.
        reference: what bounds are about; None without one.
    """

    study: Study
    camouflages: dict[str, Path]
    points: tuple[Measured, ...]
    attacked: tuple[str, ...]
    reference: Naturalness | None


def points(
    base: Naturalness | None, bounds: Sequence[float], features: Sequence[float]
) -> dict[str, Naturalness | None]:
    """By label what is asked of a camouflage: a free one, then one per bound and one per size of patch, cm.

    Args:
        base: what is asked of every point, such as a palette; its reference is what bounds are about.
    """
    shared = base or Naturalness()
    nowhere = shared.model_copy(update={"reference": None, "reference_sha256": None})

    def asked(wanted: Naturalness, **more: float) -> Naturalness:
        return Naturalness(**{**wanted.model_dump(), **more})

    return {
        FREE: None if nowhere.empty else nowhere,
        **{f"dE-{bound:g}": asked(shared, max_delta_e=bound) for bound in bounds},
        **{f"patch-{size:g}cm": asked(nowhere, feature_cm=size) for size in features},
    }


def tradeoff(
    dataset: Dataset | Path | str,
    wanted: Mapping[str, Naturalness | None],
    out: Path | str,
    *,
    attacked: Sequence[Detector | str] = ("yolov3-tiny",),
    detectors: Sequence[Detector | str] = (),
    weathers: Sequence[str] = ("seen",),
    sizes: Sizes | None = None,
    seed: int = 0,
    command: str = "",
    **means: Unpack[Means],
) -> TradeOff:
    """Optimize a camouflage for each point and judge all; points differ in what is asked of the paint alone.

    Args:
        dataset: with light maps, to optimize on.
        wanted: as of :func:`points`.
        detectors: to measure with, beside the attacked ones; every one that is ready if there are none.

    Raises:
        RaucaError: as `optimize` and `evaluate` do, before anything is optimized where that can be told.
    """
    data, size, out = dataset if isinstance(dataset, Dataset) else Dataset(Path(dataset)), sizes or Sizes(), Path(out)
    vehicle, sets = read_vehicle_choice(data.vehicle_folder), weather_sets(weathers)
    engine = open_engine(out / "store", [data.folder], **means)
    every = [*attacked, *(detectors or ["all"])]
    chosen = detectors_for(every, [vehicle.category], engine.machine, published=True)
    white_boxes = chosen[vehicle.category][: len(attacked)]
    training = recipes.views_in(data.folder)
    paints = {}
    for label, natural in wanted.items():
        settings = make_settings(
            steps=size.steps, batch=size.batch, map_size=size.map_size, seed=seed, samples=size.subsamples,
            checkpoint_every=50, name=label, natural=natural, target=vehicle.target,
        )  # fmt: skip
        paints[label] = recipes.paint(training, settings, white_boxes)
    with alone_in(out):
        folders = engine.make_named(paints)
        for label, folder in folders.items():
            link(out / "points" / label, folder)
        made = {label: folder / CAMOUFLAGE for label, folder in folders.items()}
        worn = {vehicle: keep_paints(engine, out / "study", vehicle, made, None)}
        held_out = HeldOut(size.frames, size=size.size, samples=size.samples)
        places = held_out_places([vehicle], sets, held_out)
        study = judge(engine, out / "study", places, worn, Judges(chosen), command)
    reference = next((one for one in wanted.values() if one is not None and one.reference), None)
    body = load_vehicle(vehicle.folder, read_image)
    measured = tuple(_measure(body, label, path, reference) for label, path in made.items())
    return TradeOff(study, made, measured, tuple(detector.name for _, detector in white_boxes), reference)


def _measure(vehicle: Vehicle, label: str, path: Path, reference: Naturalness | None) -> Measured:
    """Measure a camouflage on the vehicle; raises :class:`RaucaError` for one that is missing or damaged."""
    record, image = load_camouflage(path)
    uv_map, wanted = read_image(image), record.made["settings"].get("natural") or {}
    feature, sizes = wanted.get("feature_cm"), (math.inf, math.inf)
    if feature is not None:
        found = measure_patches(vehicle, uv_map, max(feature / 1000, FINEST_CUBE_M))
        sizes = found.smallest, found.median
    smallest, median = (100 * size if math.isfinite(size) else None for size in sizes)
    distance = None if reference is None else distance_of_map(vehicle, uv_map, reference)
    losses = record.made["final_losses"]
    return Measured(label, wanted.get("max_delta_e"), feature, distance, smallest, median, losses)
