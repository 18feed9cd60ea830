"""An ablation from end to end: training sets -> variants -> one study of all of them -> table and verdicts.

``rauca ablate NAME --out DIR`` runs it; run again to resume. What ablations share lies in a folder of its own, see
`ablate_workspace`; DIR holds what belongs to this one::

    ablation.html, .json, .csv        the table, the paper's beside it, what became of its orderings
    study.json, camouflages/          as of `rauca evaluate`; `rauca report DIR` works on it, too
    <weathers>/results.json           with detections/
    timings.json                      what took how long
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from pipelines.ablate_clock import Clock
from pipelines.ablate_workspace import HeldOutViews, Workspace, pour
from pipelines.console import console, progress_bar
from pipelines.going_on import goes_on_by_itself
from pipelines.optimize_camouflage import optimize_camouflage
from rauca_core.attack import OptimizerSettings, make_settings, random_camouflage
from rauca_core.attack.methods import settings_of
from rauca_core.contract import Progress, load_camouflage, load_vehicle
from rauca_core.detect import Detector
from rauca_core.report import write_ablation
from rauca_core.runtime.folder_lock import alone_in
from rauca_core.runtime.images import read_image
from rauca_core.study import DetectionSettings, reference_images
from rauca_core.study import measure as measure_views
from rauca_core.study.ablations import DEFAULT, Experiment, Findings, Sizes, Variant
from rauca_core.study.contestants import NORMAL, RANDOM, Contestant, keep_copy
from rauca_core.study.images_of import ImageOf
from rauca_core.study.study import FILE_NAME, Entry, load_study, save_study

RANDOM_SEED, RANDOM_CELL = 1, 8  # as in `rauca evaluate`
CHECKPOINT_EVERY = 100


@dataclass(frozen=True)
class Ablation:
    """What is asked for; everything in it was checked.

    Attributes:
        command: that asks for it, as typed.
        variants: of the experiment, those that take part.
        seeds: how many camouflages of each.
        attacked: white boxes, by what was typed to name them.
        detectors: to measure with.
    """

    command: str
    experiment: Experiment
    variants: Sequence[Variant]
    seeds: int
    sizes: Sizes
    out: Path
    workspace: Workspace
    attacked: Mapping[str, Detector]
    detectors: Sequence[Detector]
    threads: int | None = None
    resamples: int = 1000
    device: str = "cpu"

    @cached_property
    def clock(self) -> Clock:
        """What took how long."""
        return Clock(self.out / "timings.json")


@dataclass(frozen=True)
class Repeat:
    """One camouflage of a variant; ``label`` names it in the study."""

    variant: Variant
    seed: int
    label: str


@goes_on_by_itself()
def run_ablation(asked: Ablation) -> Path:
    """Run or resume an ablation; returns its page.

    Raises:
        RaucaError: settings that the optimizer does not take, before anything is made; another process at work there.
    """
    for repeat in _repeats(asked):
        settings_of_repeat(asked, repeat)
    with alone_in(asked.out):
        return _run(asked)


def _run(asked: Ablation) -> Path:
    repeats = _repeats(asked)
    made = {}
    for number, repeat in enumerate(repeats, start=1):
        console.print(f"camouflage {number} of {len(repeats)}: {repeat.variant.title}, seed {repeat.seed}")
        made[repeat.label] = _optimize(asked, repeat)
    copies = _copies(asked, made)
    entries = []
    for weathers in asked.sizes.weathers:
        with asked.clock.time(f"held-out views, {weathers}"):
            views = asked.workspace.views(weathers)
        entries.append(_measure(asked, views, copies))
        save_study(asked.out / FILE_NAME, asked.command, entries)
    paints = {v.key: [r.label for r in repeats if r.variant is v] for v in asked.variants}
    settings = {v.key: own_settings(asked, v) for v in asked.variants}
    found = Findings(
        asked.experiment,
        tuple(asked.variants),
        load_study(asked.out),
        {NORMAL: [NORMAL], RANDOM: [RANDOM], **paints},
        tuple(detector.name for detector in asked.attacked.values()),
        settings,
        _common(asked),
        asked.clock.seconds,
    )
    return write_ablation(found, asked.out / "ablation.html")[0]


def _repeats(asked: Ablation) -> list[Repeat]:
    """All first seeds before any second: a run that is stopped has every variant."""
    several = asked.seeds > 1
    return [
        Repeat(variant, seed, f"{variant.key} s{seed}" if several else variant.key)
        for seed in range(asked.seeds)
        for variant in asked.variants
    ]


def _optimize(asked: Ablation, repeat: Repeat) -> Path:
    """A variant's camouflage, from the workspace if it was made for any ablation."""
    variant, workspace = repeat.variant, asked.workspace
    with asked.clock.time(f"training set, {variant.training}"):
        training = workspace.training(variant.training, variant.share)
    settings = settings_of_repeat(asked, repeat)
    if settings.light == "published":
        with asked.clock.time("the published extractor"):
            weights = workspace.published_extractor(training)
        settings = settings.model_copy(update={"extractor": weights})
    usual = make_settings().identity()  # left out: a setting that comes to be later changes no older run
    epochs = asked.sizes.extractor_epochs
    trained = {"epochs": epochs} if settings.light == "published" and epochs != DEFAULT.extractor_epochs else {}
    key = {
        "settings": {
            name: value
            for name, value in settings.identity().items()
            if value != usual.get(name) and name not in ("extractor", "steps")
        },
        "steps": settings.steps,
        "training": training.name,
        "detectors": [detector.fingerprint for detector in asked.attacked.values()],
        **trained,
    }
    white_boxes = list(asked.attacked)
    with asked.clock.time(f"optimizing {repeat.label}"):
        return workspace.run(
            variant.key, key, lambda out, resume: optimize_camouflage(training, white_boxes, settings, out, resume)
        )


def settings_of_repeat(asked: Ablation, repeat: Repeat) -> OptimizerSettings:
    """Of a variant's optimization."""
    variant = repeat.variant
    chosen = {**_usual(asked), "seed": repeat.seed, "name": repeat.label, **variant.settings}
    return make_settings(**(chosen if variant.method is None else settings_of(variant.method, **chosen)))


def _usual(asked: Ablation) -> dict[str, Any]:
    """Settings that all optimizations share unless a variant says otherwise."""
    sizes = asked.sizes
    return {
        "steps": sizes.steps,
        "batch": sizes.batch,
        "lr": sizes.lr,
        "map_size": sizes.map_size,
        "target": asked.workspace.vehicle.category,
        "threads": asked.threads,
        "tap_folder": asked.workspace.folder / "taps",
        "checkpoint_every": CHECKPOINT_EVERY,
    }


def _copies(asked: Ablation, made: Mapping[str, Path]) -> dict[str, Path]:
    """The ablation's own copies of its camouflages by label, random paint first."""
    folder = asked.out / "camouflages"
    random = folder / f"{RANDOM}.json"
    vehicle = load_vehicle(asked.workspace.vehicle.folder, read_image)
    random_camouflage(random, vehicle, asked.sizes.map_size, RANDOM_SEED, RANDOM_CELL)
    return {RANDOM: random} | {label: keep_copy(_contestant(label, path), folder) for label, path in made.items()}


def _contestant(label: str, path: Path) -> Contestant:
    return Contestant(label, path, load_camouflage(path)[0])


def _measure(asked: Ablation, views: HeldOutViews, copies: Mapping[str, Path]) -> Entry:
    """Render all camouflages on the views, detect in them, and write the results."""
    workspace, folder = asked.workspace, asked.out / views.weathers
    with asked.clock.time(f"re-rendering, {views.weathers}"):
        renders = workspace.renders(views, copies)
    dataset = views.dataset
    paints: dict[str, Path | ImageOf] = {NORMAL: reference_images(dataset), **renders}
    shared = workspace.folder / "detections" / views.folder.name
    pour(shared, folder / "detections")
    try:
        with asked.clock.time(f"detecting, {views.weathers}"), progress_bar(f"detecting, {views.weathers}") as move:
            results = measure_views(
                dataset,
                paints,
                asked.detectors,
                folder,
                on_progress=lambda what, done, total: move(Progress(done, total, what)),
                settings=DetectionSettings(workspace.vehicle.category),
                resamples=asked.resamples,
                only=views.ids,
                device=asked.device,
            )
    finally:
        pour(folder / "detections", shared)
    vehicle = workspace.vehicle
    return Entry(views.weathers, "none", vehicle.name, vehicle.category, results, folder, views.folder, dict(copies))


def own_settings(asked: Ablation, variant: Variant) -> dict[str, Any]:
    """What a variant's optimization does otherwise than the common one."""
    chosen = settings_of_repeat(asked, Repeat(variant, 0, variant.key))
    usual = make_settings(**_usual(asked)).identity()
    own = {name: value for name, value in chosen.identity().items() if value != usual.get(name) and name != "steps"}
    if chosen.natural is not None:
        own["natural"] = chosen.natural.model_dump(mode="json", exclude_defaults=True)
    part = {} if variant.share == 1 else {"share of frames": f"1/{round(1 / variant.share)}"}
    return {**own, "data set": variant.training, **part}


def _common(asked: Ablation) -> dict[str, Any]:
    sizes = asked.sizes
    return {
        "vehicle": asked.workspace.vehicle.name,
        "attacked": ", ".join(detector.name for detector in asked.attacked.values()),
        "steps": f"{sizes.steps}, {sizes.batch} frames each, learning rate {sizes.lr:g}",
        "UV map": f"{sizes.map_size} x {sizes.map_size} texels",
        "training frames": f"{sizes.frames} planned of each data set; those that hide most of the paint are left out",
        "held-out frames": f"{sizes.held_out} planned per weather set, in another town",
        "frames": f"{sizes.pixels} x {sizes.pixels} pixels, {sizes.samples} samples per pixel, denoised",
        "optimizations per variant": asked.seeds,
    }
