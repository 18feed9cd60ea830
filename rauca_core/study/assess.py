"""The assessment: one detector under a frozen battery, in plain and random paint, in a library of camouflages, and in
one that is made against the detector itself.

Folder, run again to resume; views and renders lie in the user's cache, where the next detector finds them::

    assess.json                       what `assessment` describes
    study.json, <vehicle>/<views>/    as of `evaluate`
    white-box/<vehicle>/              links to the optimizations against the detector
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Unpack

import torch

from ..attack import make_settings, settings_of
from ..contract import RaucaError, balanced_frames
from ..detect import Detector, family_of
from ..runtime.folder_lock import alone_in
from . import recipes
from .assessment import Assessed, Assessment, Score, save_assessment
from .battery import LATEST, Battery, load_battery
from .candidates import NORMAL, RANDOM, VehicleChoice
from .defences import NO_DEFENCE, make_defence
from .detectors import Chosen, detectors_for
from .engine import Engine, Means, open_engine
from .evaluate import keep_paints
from .judging import Judges, Place, judge
from .makers import CAMOUFLAGE
from .pooled import Pool
from .store import link, user_cache
from .study import Study
from .weak_spots import half_recall_range, worst_cell, worst_tenth

FILE_NAME = "assess.json"
WHITE_BOX = "white-box"
THRESHOLD = 0.25  # the score that Ultralytics and most others deploy with


@dataclass(frozen=True)
class Effort:
    """What the attack on the detector itself may cost: ``steps`` on ``frames`` views of each vehicle."""

    frames: int
    steps: int


EFFORTS = {"quick": Effort(48, 300), "standard": Effort(192, 1000), "overnight": Effort(384, 3000)}
TOWN_SEED = 31_500  # where attacks are optimized: neither the battery's places nor the library's


def assess(
    detector: Detector | str,
    out: Path | str,
    *,
    battery: str = LATEST,
    budget: str = "quick",
    white_box: bool = True,
    defences: Sequence[str] = (),
    threshold: float = THRESHOLD,
    resamples: int = 1000,
    command: str = "",
    **means: Unpack[Means],
) -> tuple[Assessment, Study]:
    """Assess a detector, or go on with an assessment in ``out``.

    Args:
        detector: a loaded one, or a name or file.
        battery: name of a shipped one.
        budget: ``quick``, ``standard`` or ``overnight``: how much of the battery, and of an attack.
        white_box: attack the detector itself, too, if it has gradients.
        defences: to look through beside none.
        threshold: score at which the detector is deployed, for recall and mistakes.
        command: what was typed, for the report.
        means: see :class:`~rauca_core.study.engine.Means`.

    Raises:
        RaucaError: a mistake, before anything is rendered; another process at work in ``out``.
    """
    began, out, frozen = time.monotonic(), Path(out), load_battery(battery)
    engine = open_engine(user_cache(), [], **means)
    (chosen,) = detectors_for([detector], [frozen.category], engine.machine)[frozen.category]
    loaded = chosen[1]
    why_not = _why_no_white_box(loaded) if white_box else "it was not asked for"
    choices = frozen.choices()
    looked_through = [make_defence(name) for name in dict.fromkeys((NO_DEFENCE, *defences))]
    with alone_in(out):
        paints = {}
        for vehicle, choice in choices.items():
            worn = dict(frozen.camouflages_of(vehicle))
            if not why_not:
                worn[WHITE_BOX] = _attack(engine, out, choice, frozen, chosen, EFFORTS[budget])
            paints[choice] = keep_paints(engine, out, choice, worn, frozen.random)
        places = [
            Place(name, choice, views)
            for choice in choices.values()
            for name, views in frozen.views_of(choice, budget).items()
        ]
        judges = Judges({frozen.category: [chosen]}, looked_through, resamples)
        study = judge(engine, out, places, paints, judges, command)
        assessed = Assessed(
            loaded.name, family_of(loaded), loaded.fingerprint, not _why_no_white_box(loaded), why_not,
            milliseconds(loaded, places[0].views.settings["plan"]["size"], engine.machine.device),
        )  # fmt: skip
        found = summarize(assessed, frozen, budget, threshold, study, why_not, resamples)
        spent = {**engine.seconds, "all, this time": round(time.monotonic() - began, 1)}
        found = replace(found, seconds=spent)
        save_assessment(out / FILE_NAME, found)
    return found, study


def _attack(engine: Engine, out: Path, choice: VehicleChoice, battery: Battery, chosen: Chosen, effort: Effort) -> Path:
    """A camouflage (JSON) made against the detector, on views of a town that nobody is judged in."""
    typed, detector = chosen
    body = recipes.vehicle_in(choice.folder)
    judged = battery.views[0].plan
    plan = replace(
        judged, vehicle_name=choice.name, atlas_id=choice.atlas_id, light=True, seed=TOWN_SEED,
        quality=replace(judged.quality, composed_fog=True),
    )  # fmt: skip
    views = recipes.data_set(f"attack-{choice.name}", plan, body, balanced_frames(plan, effort.frames), exact=True)
    wanted = {"steps": effort.steps, "map_size": 512, "augmentation": "ours", "rest": 3, "checkpoint_every": 50}
    settings = make_settings(**settings_of("ours", **wanted, target=choice.target, name=WHITE_BOX))
    (folder,) = engine.make(recipes.paint(views, settings, [detector], [typed]))
    link(out / WHITE_BOX / choice.name, folder)
    return folder / CAMOUFLAGE


def _why_no_white_box(detector: Detector) -> str:
    """Empty where gradients flow from the detector's predictions to the image."""
    image = torch.full((1, 3, 64, 64), 0.5, requires_grad=True)
    try:
        found = detector.dense(image)
    except RaucaError as error:
        return str(error)
    scores = found.objectness[..., None] * found.classes
    return "" if scores.requires_grad else f"{detector.name}: no gradient flows from its predictions to the image"


def milliseconds(detector: Detector, size: int, device: str, repeats: int = 5) -> float:
    """Median time of an image of ``size`` x ``size`` pixels, the first one left out."""
    image = torch.rand(1, 3, size, size, generator=torch.Generator().manual_seed(0)).to(device)
    spent = []
    for _ in range(repeats + 1):
        began = time.perf_counter()
        detector.detect(image)
        spent.append(1000 * (time.perf_counter() - began))
    return round(statistics.median(spent[1:]), 2)


def summarize(
    assessed: Assessed, battery: Battery, budget: str, threshold: float, study: Study, note: str, resamples: int
) -> Assessment:
    """The figures of an assessment, from what the detector found."""
    towns = {views.name: views.plan.seed for views in battery.views}
    pools = {
        defence: Pool(study.of(defence=defence), assessed.name, lambda entry: towns[entry.weathers], resamples)
        for defence in dict.fromkeys(entry.defence for entry in study.entries)
    }
    plain = pools[NO_DEFENCE]
    library = [paint for paint in plain.paints if paint not in (NORMAL, RANDOM, WHITE_BOX)]

    def score(pool: Pool, *paints: str) -> Score:
        return pool.score(paints, threshold)

    return Assessment(
        detector=assessed,
        battery=battery.name,
        budget=budget,
        threshold=threshold,
        clean=score(plain, NORMAL),
        random=score(plain, RANDOM),
        transfer=score(plain, *library),
        white_box=score(plain, WHITE_BOX) if WHITE_BOX in plain.paints else None,
        white_box_note=note,
        transfer_by_camouflage={paint: score(plain, paint) for paint in library},
        worst_cell={paint: worst_cell(plain.rows, plain.scores(paint), threshold) for paint in plain.paints},
        worst_tenth={paint: worst_tenth(plain.rows, plain.scores(paint), threshold) for paint in plain.paints},
        errors={paint: plain.mistakes(paint, threshold) for paint in plain.paints},
        range_m={paint: half_recall_range(plain.rows, plain.scores(paint), threshold) for paint in plain.paints},
        defences={
            name: {paint: score(pool, paint) for paint in pool.paints}
            for name, pool in pools.items()
            if name != NO_DEFENCE
        },
    )
