"""An ablation from end to end: training sets -> variants -> one study of all of them -> findings.

Run again to resume. What ablations share lies in one store: training sets, views, camouflages and their renders, each
made once, whatever ablation comes first. The ablation's own folder holds what `evaluate` describes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

from ..attack import OptimizerSettings, make_settings, settings_of
from ..contract import Plan, Quality, balanced_frames, load_vehicle
from ..contract.towns import TRAINING
from ..detect import Detector
from ..runtime.folder_lock import alone_in
from ..runtime.images import read_image
from . import recipes
from .ablations.catalogue import experiment_named
from .ablations.experiment import Experiment, Sizes, Variant
from .ablations.findings import Findings
from .artifact import Artifact
from .candidates import NORMAL, RANDOM, VehicleChoice, find_vehicles
from .detectors import Chosen, detectors_for
from .engine import Means, open_engine
from .evaluate import RandomPaint, held_out_places, keep_paints
from .judging import Judges, judge
from .makers import CAMOUFLAGE
from .views import RING, HeldOut, weather_sets, weathers_named

CHECKPOINT_EVERY = 100
# Data sets that variants are optimized on, as many frames of each, so that only what they show differs: all stand in
# one town, which is not the held-out one, and see the vehicle from where it is measured. As in the paper, `single` and
# `base` see it from fixed points in clearcoat paint, and `enhanced` from points that move, in its own paint.
LOCATIONS = 8
_STILL = replace(RING, jitter_azimuth_deg=0.0, jitter_elevation_deg=0.0, jitter_distance=0.0, jitter_aim_m=0.0)
TRAINING_SETS = {"single": (_STILL, "car_paint"), "base": (_STILL, "car_paint"), "enhanced": (RING, "own")}
"""By the name of their weathers' preset: cameras, and finish of the paint."""


@dataclass(frozen=True)
class Ablation:
    """What is asked for.

    Attributes:
        variants: of the experiment, those that take part.
        seeds: how many camouflages of each.
        taps: where the optimizations keep them.
    """

    experiment: Experiment
    variants: Sequence[Variant]
    seeds: int
    sizes: Sizes
    vehicle: VehicleChoice
    taps: Path | None = None

    def repeats(self) -> list[tuple[Variant, int, str]]:
        """Variant, seed and label of every camouflage; all first seeds before any second, for one that is stopped."""
        return [
            (variant, seed, f"{variant.key} s{seed}" if self.seeds > 1 else variant.key)
            for seed in range(self.seeds)
            for variant in self.variants
        ]

    def settings(self, variant: Variant, seed: int = 0, label: str = "") -> OptimizerSettings:
        """Of a variant's optimization: the common ones, over them its method's own, over them the variant's.

        So a row that is named after a method is that method, at this ablation's size.
        """
        chosen = {**self._size(), "seed": seed, "name": label or variant.key, **variant.settings}
        if variant.method is not None:
            return make_settings(**settings_of(variant.method, **chosen))
        return make_settings(**{"lr": self.sizes.lr, **chosen})

    def own_settings(self, variant: Variant) -> dict[str, Any]:
        """What a variant's optimization does otherwise than the common one."""
        chosen = self.settings(variant)
        usual = make_settings(lr=self.sizes.lr, **self._size()).identity()
        own = {name: value for name, value in chosen.identity().items() if value != usual.get(name) and name != "steps"}
        if chosen.natural is not None:
            own["natural"] = chosen.natural.model_dump(mode="json", exclude_defaults=True)
        part = {} if variant.share == 1 else {"share of frames": f"1/{round(1 / variant.share)}"}
        return {**own, "data set": variant.training, **part}

    def training(self, variant: Variant) -> Artifact:
        """The data set that a variant is optimized on."""
        plan, body = training_plan(variant.training, self.vehicle, self.sizes), recipes.vehicle_in(self.vehicle.folder)
        ids, part = chosen_frames(plan, self.sizes), chosen_frames(plan, self.sizes, variant.share)
        whole = recipes.data_set(variant.training, plan, body, ids, exact=True)
        return whole if len(part) == len(ids) else recipes.part_of(whole, f"{variant.training}-{len(part)}", part)

    def paint(self, variant: Variant, seed: int, label: str, attacked: Sequence[Chosen]) -> Artifact:
        """A camouflage of a variant; two that differ in their labels alone are the same."""
        training, settings = self.training(variant), self.settings(variant, seed, label)
        published = settings.light == "published"
        extractor = recipes.extractor(training, self.sizes.extractor_epochs) if published else None
        return recipes.paint(training, settings, attacked, extractor)

    def _size(self) -> dict[str, Any]:
        """Settings that all optimizations share unless a variant says otherwise; the learning rate is a method's."""
        sizes = self.sizes
        return {
            "steps": sizes.steps, "batch": sizes.batch, "map_size": sizes.map_size, "target": self.vehicle.category,
            "tap_folder": self.taps, "checkpoint_every": CHECKPOINT_EVERY,
        }  # fmt: skip

    def common(self, attacked: Sequence[Chosen]) -> dict[str, Any]:
        """What all variants share, for the reader."""
        sizes = self.sizes
        return {
            "vehicle": self.vehicle.name,
            "attacked": ", ".join(detector.name for _, detector in attacked),
            "steps": f"{sizes.steps}, {sizes.batch} frames each; learning rate {sizes.lr:g} but for rows of a method",
            "UV map": f"{sizes.map_size} x {sizes.map_size} texels",
            "training frames": f"{sizes.frames} planned of each data set, without those that hide most of the paint",
            "held-out frames": f"{sizes.held_out} planned per weather set, in a town that only choices are made in",
            "frames": f"{sizes.pixels} x {sizes.pixels} pixels, {sizes.samples} samples per pixel, denoised",
            "optimizations per variant": self.seeds,
        }


def ablate(
    name: str,
    out: Path | str,
    *,
    variants: Sequence[str] = (),
    quick: bool = False,
    sizes: Sizes | None = None,
    vehicle: str = "sedan",
    attacked: Sequence[Detector | str] = ("yolov3-tiny",),
    store: Path | None = None,
    command: str = "",
    **means: Unpack[Means],
) -> Findings:
    """Run or resume an ablation.

    Args:
        name: of the experiment, see `ablations.EXPERIMENTS`.
        variants: keys of those that take part; all if left out, of the quick size's if ``quick``.
        store: what ablations share; in ``out`` if left out.

    Raises:
        RaucaError: settings that the optimizer does not take, before anything is made; another process at work there.
    """
    experiment, body, out = experiment_named(name), find_vehicles([vehicle])[0], Path(out)
    sizes = sizes or Sizes()
    sets = weather_sets(sizes.weathers)
    some = [experiment.variant(key) for key in dict.fromkeys(variants)]
    some = some or [variant for variant in experiment.variants if variant.quick or not quick]
    place = store or out / "store"
    asked = Ablation(experiment, some, sizes.seeds or experiment.seeds, sizes, body, place / "taps")
    for repeat in asked.repeats():
        asked.settings(*repeat)
    engine = open_engine(place, **means)
    white_boxes = detectors_for(attacked, [body.category], engine.machine)[body.category]
    chosen = detectors_for(sizes.detectors or (), [body.category], engine.machine, published=True)
    with alone_in(out):
        wanted = {label: asked.paint(variant, seed, label, white_boxes) for variant, seed, label in asked.repeats()}
        made = {label: folder / CAMOUFLAGE for label, folder in engine.make_named(wanted).items()}
        paints = {body: keep_paints(engine, out, body, made, RandomPaint(size=sizes.map_size))}
        places = held_out_places([body], sets, sizes.views)
        study = judge(engine, out, places, paints, Judges(chosen), command)
    rows = {v.key: [label for variant, _, label in asked.repeats() if variant is v] for v in some}
    settings = {variant.key: asked.own_settings(variant) for variant in some}
    names = tuple(detector.name for _, detector in white_boxes)
    of_rows = {NORMAL: [NORMAL], RANDOM: [RANDOM], **rows}
    return Findings(experiment, tuple(some), study, of_rows, names, settings, asked.common(white_boxes), engine.seconds)


def training_plan(name: str, vehicle: VehicleChoice, sizes: Sizes) -> Plan:
    """All of a training set, of which :func:`chosen_frames` takes a part; large vehicles are seen from farther away."""
    cameras, finish = TRAINING_SETS[name]
    ring = HeldOut(ring=cameras).fitted(load_vehicle(vehicle.folder, read_image).positions).ring
    return Plan.of(
        weathers_named(name), ring, name=name, vehicle_name=vehicle.name, atlas_id=vehicle.atlas_id, finish=finish,
        size=sizes.pixels, quality=Quality(sizes.samples), locations=LOCATIONS, seed=TRAINING["ablations"],
    )  # fmt: skip


def chosen_frames(plan: Plan, sizes: Sizes, share: float = 1.0) -> list[str]:
    """Ids of a balanced part of a plan, in its order; a smaller ``share`` is a part of a larger one."""
    return balanced_frames(plan, max(1, round(share * sizes.frames)))
