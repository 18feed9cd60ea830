"""The assessment: one detector under a frozen battery, in plain and random paint, in a library of camouflages, and in
one that is made against the detector itself.

Folder, run again to resume; views and renders lie in the user's cache, where the next detector finds them::

    assess.json                         what `assessment` describes
    study.json, <vehicle>/<views>/      as of `evaluate`
    pictures/                           the same of pictures from elsewhere, composed
    clips/                              the same of clips, in fewer paints
    attacks/<vehicle>/white-box         links to the optimizations against the detector; one that knows of a defence is
                                        called informed-<defence>
"""

from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Unpack

from ..attack import make_settings, settings_of
from ..contract import Clips, Dataset, RaucaError, load_camouflage
from ..detect import Detector
from ..motion.tracks import require_trackers
from ..runtime.folder_lock import alone_in
from . import recipes
from .assessment import Assessed, Assessment, Defended, Score, save_assessment
from .battery import LATEST, Battery, load_battery
from .candidates import NORMAL, RANDOM, VehicleChoice, read_vehicle_choice
from .cost import Work
from .defences import NO_DEFENCE, make_defence
from .defences.informed import DefendedDetector
from .detectors import Chosen, detectors_for
from .driven import Drives, measure_drives, over_vehicles
from .engine import Engine, Means, open_engine
from .evaluate import given_places, held_out_places, keep_paints, open_views
from .judging import Judges, Place, judge
from .makers import CAMOUFLAGE
from .pooled import Pool
from .preflight import DEPLOYED, Preflight, preflight
from .ranking import best_of
from .store import link, user_cache
from .study import Study
from .views import HeldOut, weather_sets, weathers_named
from .weak_spots import half_recall_range, worst_cell, worst_tenth

FILE_NAME = "assess.json"
WHITE_BOX, INFORMED, PICTURES, CLIPS = "white-box", "informed-", "pictures", "clips"
MAP_SIZE = 512  # texels, of the library's maps and of the attacks


@dataclass(frozen=True)
class Effort:
    """What an attack on the detector may cost: on each vehicle ``frames`` views, and ``steps`` in each of ``runs``."""

    frames: int
    steps: int
    runs: int = 1


@dataclass(frozen=True)
class Driving:
    """Clips past each vehicle of a battery, and the tracker that follows it.

    Attributes:
        clips: driven in the town of `rauca evaluate --clips`, with the battery's image size and samples.
        weathers: sets of them, as of `evaluate`.
    """

    clips: Clips
    weathers: tuple[str, ...] = ("single",)
    tracker: str = "bytetrack"

    def check(self) -> None:
        """Raise :class:`RaucaError` for a mistake, or without a library of trackers."""
        require_trackers()
        self.clips.check("--clips")
        weather_sets(self.weathers)


EFFORTS = {"quick": Effort(12, 120), "standard": Effort(192, 1000), "overnight": Effort(384, 2000, runs=3)}


def assess(
    detector: Detector | str,
    out: Path | str,
    *,
    checked: Preflight | None = None,
    battery: str = LATEST,
    budget: str = "quick",
    vehicles: Sequence[str] = (),
    white_box: bool = True,
    defences: Sequence[str] = (),
    threshold: float = DEPLOYED,
    pictures: Sequence[Path] = (),
    clips: Driving | None = None,
    command: str = "",
    **means: Unpack[Means],
) -> tuple[Assessment, Study]:
    """Assess a detector, or go on with an assessment in ``out``.

    Args:
        detector: a loaded one, or a name or file.
        checked: what a first look at it said; made here if left out.
        battery: name of a shipped one.
        budget: ``quick``, ``standard`` or ``overnight``: how much of the battery, and of an attack.
        vehicles: only these of the battery.
        white_box: attack the detector itself, too, if it has gradients.
        defences: to look through beside none.
        threshold: score at which the detector is deployed, for recall and mistakes.
        pictures: data sets of pictures from elsewhere, judged on in a study of their own, ``out/pictures``.
        clips: to drive, too, judged on in a study of their own, ``out/clips``.
        command: what was typed, for the report.
        means: see :class:`~rauca_core.study.engine.Means`.

    Returns:
        The assessment, as it lies in ``out``, and the study behind it.

    Raises:
        RaucaError: a mistake, before anything is rendered; another process at work in ``out``.
    """
    began, out, frozen = time.monotonic(), Path(out), load_battery(battery)
    choices, shown = frozen.choices(vehicles), _open_pictures(pictures, frozen.category)
    if clips is not None:
        clips.check()
    looked_through = [make_defence(name) for name in dict.fromkeys((NO_DEFENCE, *defences))]
    engine = open_engine(user_cache(), [], **means)
    (chosen,) = detectors_for([detector], [frozen.category], engine.machine)[frozen.category]
    checked = checked or preflight(chosen[1], frozen.category, device=engine.machine.device)
    assessed = Assessed(
        checked.name, checked.family, chosen[1].fingerprint, checked.differentiable, checked.why_not,
        round(checked.ms_forward, 2),
    )  # fmt: skip
    attacked = {WHITE_BOX: chosen} if white_box and assessed.differentiable else {}
    for defence in looked_through[1:] if attacked else ():
        behind = DefendedDetector(chosen[1], defence)
        engine.machine.loaded[behind.fingerprint] = behind
        attacked[informed(defence.name)] = behind.name, behind
    with alone_in(out):
        paints = {}
        for vehicle, choice in choices:
            library = frozen.camouflages_of(vehicle)
            worn = dict(library)
            for label, target in attacked.items():
                # One that knows of a defence may begin with what does not, so that it never starts behind it.
                worn[label] = _attack(engine, out, choice, frozen, worn, target, EFFORTS[budget], label)
            paints[choice] = keep_paints(engine, out, choice, worn, frozen.random)
        places = [
            Place(name, choice, views)
            for _, choice in choices
            for name, views in frozen.views_of(choice, budget).items()
        ]
        judges = Judges({frozen.category: [chosen]}, looked_through)
        study = judge(engine, out, places, paints, judges, command)
        if shown:
            _judge_pictures(engine, out / PICTURES, shown, paints, frozen, judges, command)
        found = summarize(assessed, frozen, budget, threshold, study)
        if clips is not None:
            found = replace(found, clips=_drive(engine, out / CLIPS, clips, paints, found, frozen, judges, command))
        note = told_of_attack(found, EFFORTS[budget], white_box, assessed)
        spent = {**engine.seconds, "all, this time": round(time.monotonic() - began, 1)}
        found = replace(found, white_box_note=note, seconds=spent)
        save_assessment(out / FILE_NAME, found)
    return found, study


def _open_pictures(folders: Sequence[Path], category: str) -> dict[VehicleChoice, list[Dataset]]:
    """Data sets of pictures by vehicle; raises :class:`RaucaError` for others, and for vehicles of another class."""
    opened = open_views(folders, pictures=True)
    if opened and not opened[0].require_rendered_or_pictured("detectors are judged on"):
        raise RaucaError(f"--pictures {opened[0].folder}: was rendered; `rauca evaluate` takes it")
    choices = {one.plan.atlas_id: read_vehicle_choice(one.vehicle_folder) for one in opened}
    if strange := next((choice for choice in choices.values() if choice.category != category), None):
        raise RaucaError(f"--pictures: show a {strange.category}, the battery is of a {category}; give pictures of one")
    return {choice: [one for one in opened if one.plan.atlas_id == atlas] for atlas, choice in choices.items()}


def _judge_pictures(
    engine: Engine,
    out: Path,
    shown: Mapping[VehicleChoice, Sequence[Dataset]],
    paints: Mapping[VehicleChoice, Mapping[str, Path]],
    battery: Battery,
    judges: Judges,
    command: str,
) -> None:
    """The battery's paints composed on pictures of its vehicles, and random paint on another: figures of their own."""
    of_atlas = {choice.atlas_id: some for choice, some in paints.items()}
    worn = {
        choice: of_atlas.get(choice.atlas_id) or keep_paints(engine, out, choice, {}, battery.random)
        for choice in shown
    }
    places = [place for choice, some in shown.items() for place in given_places(some, [choice], None)]
    judge(engine, out, places, worn, judges, command)


def _drive(
    engine: Engine,
    out: Path,
    driving: Driving,
    paints: Mapping[VehicleChoice, Mapping[str, Path]],
    found: Assessment,
    battery: Battery,
    judges: Judges,
    command: str,
) -> Drives:
    """Clips of all vehicles, plain and in the paints that a page shows, seen without a defence."""
    worn = (RANDOM, found.worst_camouflage, WHITE_BOX)
    shown = {choice: {label: path for label, path in some.items() if label in worn} for choice, some in paints.items()}
    plan = battery.views[0].plan
    views = HeldOut.driven(driving.clips, plan.size, plan.quality.samples)
    places = held_out_places(shown, weather_sets(driving.weathers), views)
    study = judge(engine, out, places, shown, Judges(judges.detectors), command)
    return over_vehicles(measure_drives(study, driving.tracker))


def works_of(
    battery: str = LATEST,
    vehicles: Sequence[str] = (),
    white_box: bool = True,
    defences: int = 0,
    clips: Driving | None = None,
) -> dict[str, Work]:
    """What each budget consists of, for an estimate of its cost.

    Args:
        defences: how many are looked through; an attack of its own knows of each.
    """
    frozen = load_battery(battery)
    count, attacks = len(frozen.choices(vehicles)), (1 + defences) * white_box
    paints = 2 + len(frozen.made_against) + attacks
    weathers = [weather for name in (clips.weathers if clips else ()) for weather in weathers_named(name)]
    driven = count * len(clips.clips) * len(weathers) if clips else 0
    return {
        budget: Work(
            views=count * sum(views.frames[budget] for views in frozen.views),
            paints=paints,
            lit_views=count * effort.frames * bool(attacks),
            steps=count * effort.steps * effort.runs * attacks,
            driven=driven,
        )
        for budget, effort in EFFORTS.items()
    }


def informed(defence: str) -> str:
    """Label of the camouflage made against the detector behind a defence."""
    return INFORMED + re.sub(r"[^A-Za-z0-9.]+", "-", defence)


def _attack(
    engine: Engine,
    out: Path,
    choice: VehicleChoice,
    battery: Battery,
    known: Mapping[str, Path],
    target: Chosen,
    effort: Effort,
    label: str,
) -> Path:
    """The strongest camouflage (JSON) against a detector that several runs found, on views nobody is judged on.

    The first run begins with the camouflage, of the library and of those made before, that hides the vehicle best from
    the detector on these views, which saves it the hundreds of steps that noise needs to become a pattern.
    """
    views = battery.attack_views(choice, effort.frames)
    wanted = {"steps": effort.steps, "map_size": MAP_SIZE, "checkpoint_every": 50}
    first: dict[str, Path] = {}
    if known:
        maps = [recipes.camouflage_in(path, name) for name, path in known.items()]
        (ranked,) = engine.make(recipes.ranking(views, maps, target[1], target[0], choice.target))
        first["begin_with"] = best_of(ranked, list(known.values()))
    runs: list[Path] = []
    for seed in range(effort.runs):
        start = first if seed == 0 else {}  # the others begin with noise
        settings = make_settings(**settings_of("ours", **wanted, **start, seed=seed, target=choice.target, name=label))
        runs += engine.make(recipes.paint(views, settings, [target]))
    best = strongest(runs)
    link(out / "attacks" / choice.name / label, best)
    return best / CAMOUFLAGE


def strongest(runs: Sequence[Path]) -> Path:
    """Of several optimizations, that whose views the detector scores lowest at the end: a choice on training views."""

    def final_score(folder: Path) -> float:
        return float(load_camouflage(folder / CAMOUFLAGE)[0].made["final_losses"]["score"])

    return min(runs, key=final_score)


def summarize(assessed: Assessed, battery: Battery, budget: str, threshold: float, study: Study) -> Assessment:
    """The figures of an assessment, from what the detector found."""
    towns = {views.name: views.plan.seed for views in battery.views}
    pools = {
        defence: Pool(study.of(defence=defence), assessed.name, lambda entry: towns[entry.weathers])
        for defence in dict.fromkeys(entry.defence for entry in study.entries)
    }
    plain, told = pools[NO_DEFENCE], [NORMAL, RANDOM]
    library = [label for label in battery.made_against if label in plain.paints]
    others = [label for label in library if assessed.sha256 not in battery.made_against[label]]
    told += [*library, *([WHITE_BOX] if WHITE_BOX in plain.paints else [])]
    groups = {"clean": [NORMAL], "random": [RANDOM], "transfer": others, "white_box": told[len(library) + 2 :]}

    def score(pool: Pool, *paints: str) -> Score | None:
        return pool.score(paints, threshold) if paints else None

    def needed(pool: Pool, *paints: str) -> Score:
        return pool.score(paints, threshold)

    scores = {paint: plain.scores(paint) for paint in told}
    return Assessment(
        detector=assessed,
        battery=battery.name,
        budget=budget,
        vehicles=tuple(dict.fromkeys(entry.vehicle for entry in study.entries)),
        threshold=threshold,
        clean=needed(plain, NORMAL),
        random=needed(plain, RANDOM),
        transfer=needed(plain, *others),
        white_box=score(plain, *groups["white_box"]),
        white_box_note="",
        transfer_by_camouflage={paint: needed(plain, paint) for paint in library},
        worst_cell={paint: worst_cell(plain.rows, scores[paint], threshold) for paint in told},
        worst_tenth={paint: worst_tenth(plain.rows, scores[paint], threshold) for paint in told},
        errors={paint: plain.mistakes(paint, threshold) for paint in told},
        range_m={paint: half_recall_range(plain.rows, scores[paint], threshold) for paint in told},
        defences={
            name: Defended(
                needed(pool, NORMAL), needed(pool, RANDOM), needed(pool, *others), score(pool, *groups["white_box"]),
                score(pool, *(paint for paint in pool.paints if paint == informed(name))),
            )
            for name, pool in pools.items()
            if name != NO_DEFENCE
        },
        without_place={
            name: tuple(round(float(ap), 6) for ap in plain.curve(paints)[1:])
            for name, paints in groups.items()
            if paints
        },
        left_out=tuple(label for label in library if label not in others),
    )  # fmt: skip


def told_of_attack(found: Assessment, effort: Effort, wanted: bool, assessed: Assessed) -> str:
    """What the attack on the detector itself consisted of, or why there was none."""
    if not wanted:
        return "it was not asked for"
    if not assessed.differentiable:
        return assessed.why_not
    runs = "one run" if effort.runs == 1 else f"the best of {effort.runs} runs"
    return (
        f"{runs} of {effort.steps} steps on {effort.frames} views of each vehicle; more steps, views or runs may find "
        "worse: this is an upper bound of the detector's robustness"
    )
