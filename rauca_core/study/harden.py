"""Harden a detector and measure what it gained.

Folder, run again to go on; every step only makes what is missing::

    hardened-<name>.safetensors, .json      the result, loaded by its path (.onnx, .pth or a folder, if that was given):
                                            links into
    store/hardened/...                      round-<k>/ with the camouflages made against the detector of that round, and
                                            the detector after it
    store/interpolated/...                  what is kept of the last one, see `interpolated`
    attacks/<vehicle>/                      links to camouflages that it is measured by, see `harden_measures`
    study/                                  both detectors on held-out views, rendered by Cycles, as of `evaluate`
    other_places/                           the same in more places, in the vehicle's own paint: for other objects alone
    hardening.json                          the figures, see `hardening_record`
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Unpack

from ..contract import Dataset, RaucaError, load_camouflage, read_plan
from ..contract.files import file_digest
from ..contract.towns import TEST
from ..detect.synth.card import read_any_card
from ..runtime.folder_lock import alone_in
from ..training.harden import identity_of
from ..training.hardenable import named_as
from ..training.settings import HardenSettings
from . import recipes
from .artifact import Artifact
from .candidates import NORMAL, RANDOM, Candidate, VehicleChoice, match, read_candidates, read_vehicle_choice
from .detecting import detections_in, pictures_in
from .detection_cache import DetectionSettings
from .detectors import Chosen, detectors_for
from .engine import Engine, Means, open_engine
from .evaluate import RandomPaint, given_places, held_out_places, keep_paints, open_views
from .harden_measures import METHOD, UNSEEN, Measures, adaptive_paints, held_out_paints
from .harden_rounds import STRONGEST, hardening
from .hardening import Gains, gains_of
from .hardening_record import Cost, Figures, cost_of
from .interpolated import Interpolation, interpolated
from .judging import Judges, Place, judge
from .other_classes import OtherClasses, other_classes_of
from .store import link
from .study import Entry, Study
from .views import HeldOut, weather_sets


@dataclass(frozen=True)
class Hardened:
    """What came of it.

    Attributes:
        weights: of the hardened detector.
        study: both on held-out views.
        figures: before and after, as in ``hardening.json``.
        made: paint -> how it was made.
        facts: what was asked for, as a reader should see it.
    """

    weights: Path
    study: Study
    figures: Figures
    made: dict[str, str]
    facts: dict[str, object]

    @property
    def before(self) -> str:
        """The first detector's name."""
        return self.figures.before

    @property
    def after(self) -> str:
        """The hardened one's."""
        return self.figures.after

    @property
    def gains(self) -> Sequence[Gains]:
        """One for each entry of the study."""
        return self.figures.gains


def harden(
    detector: str,
    datasets: Sequence[Path | str],
    held_out: Sequence[Path | str],
    out: Path | str,
    *,
    camouflages: Sequence[Path | str] = (),
    settings: HardenSettings | None = None,
    interpolation: Interpolation | None = None,
    measures: Measures | None = None,
    views: Sequence[Path | str] = (),
    weathers: Sequence[str] = ("seen",),
    held_out_views: HeldOut | None = None,
    command: str = "",
    **means: Unpack[Means],
) -> Hardened:
    """Fine-tune a detector on camouflages, fresh ones among them, and measure before and after on held-out ones.

    Args:
        detector: to harden, as `load_detector` takes it.
        datasets: with light maps, to train on; the first of each vehicle is what it is attacked on to be measured.
        held_out: camouflages, ``FILE`` or ``LABEL=FILE``, to judge by; never trained on.
        camouflages: to train on beside those made on the way.
        interpolation: how much of what was learnt is kept, and how that is decided.
        measures: by which attacks the result is judged beside them.
        views: rendered views to judge on; made anew, in ``weathers``, when there are none.

    Raises:
        RaucaError: a mistake, before any work; a loss that is not finite; a stop.
    """
    out, chosen, measured = Path(out), settings or HardenSettings.make(), measures or Measures()
    keeping, new = interpolation or Interpolation(), held_out_views or HeldOut(48)
    data, trained = [Path(one) for one in datasets], [Path(one) for one in camouflages]
    opened, sets = open_views(views), weather_sets(weathers)
    candidates = read_candidates(list(map(str, held_out)), (NORMAL, RANDOM, *measured.labels))
    if not candidates:
        raise RaucaError("--held-out: none given; a hardened detector is judged by camouflages it was not trained on")
    unseen = dict(zip(measured.check(chosen, trained, data), measured.vehicles, strict=True))
    matched = _vehicles(candidates, data, opened, list(unseen))
    attacked = [one for one in data if read_plan(one).atlas_id in {vehicle.atlas_id for vehicle in matched}]
    means.setdefault("threads", chosen.threads)
    engine = open_engine(out / "store", [*data, *(one.folder for one in opened)], **means)
    _refuse_trained(candidates, trained)
    recipe = recipe_of(engine, detector, data, attacked, trained, chosen, out, command)
    everyone = [*matched, *unseen]
    with alone_in(out):
        _refuse_trained(candidates, engine.store.place(recipe).glob("round-*/attack/**/camouflage.json"))
        (learnt,) = engine.make(recipe)
        _refuse_trained(candidates, learnt.glob("round-*/attack/**/camouflage.json"))
        (folder,) = engine.make(interpolated(detector, recipe, everyone[0], data, keeping, new))
        weights = link_weights(folder, out)
        both = detectors_for(
            [detector, named_as(detector, weights)], [one.category for one in everyone], engine.machine
        )
        before, after = next(iter(both.values()))
        worn = _worn(engine, out, matched, unseen, data, chosen, measured, before, after)
        paints = {one: keep_paints(engine, out / "study", one, some, RandomPaint()) for one, some in worn.items()}
        places = given_places(opened, everyone, None) if opened else held_out_places(everyone, sets, new)
        study = judge(engine, out / "study", places, paints, Judges(both), command)
        others = _other_places(everyone[0], sets, new, 0 if opened else measured.other_places)
        more = judge(engine, out / "other_places", others, {everyone[0]: {}}, Judges(both), command)
        held = {one.label for one in candidates}
        figures = _figures(
            engine, study, more, held, measured, before, after, cost_of(folder / weights.name, learnt), data
        )
        figures.save(out)
    facts = {
        "detector": Path(detector).name,
        "data sets": ", ".join(folder.name for folder in data),
        "camouflages trained on": ", ".join(load_camouflage(path)[0].name for path in trained) or "none given",
        **chosen.model_dump(mode="json", exclude={"threads", "memory_mb"}),
        "adaptive attacks": _told_of_budgets(chosen, measured),
        **_told_of_weights(folder / weights.name),
    }
    return Hardened(out / weights.name, study, figures, _origins(worn, held, measured), facts)


def _worn(
    engine: Engine,
    out: Path,
    matched: Mapping[VehicleChoice, list[Candidate]],
    unseen: Mapping[VehicleChoice, Path],
    data: Sequence[Path],
    settings: HardenSettings,
    measures: Measures,
    before: Chosen,
    after: Chosen,
) -> dict[VehicleChoice, dict[str, Path]]:
    """What each vehicle is judged in: given camouflages (JSON) by label, and those that are made here."""
    worn: dict[VehicleChoice, dict[str, Path]] = {}
    labels = {METHOD + method: method for method in measures.methods}
    for vehicle, some in matched.items():
        own = next(folder for folder in data if read_plan(folder).atlas_id == vehicle.atlas_id)
        worn[vehicle] = {one.label: one.path for one in some}
        worn[vehicle] |= held_out_paints(engine, out, vehicle, own, settings, labels, before)
        worn[vehicle] |= adaptive_paints(engine, out, vehicle, own, settings, measures, some, after)
    for vehicle, own in unseen.items():
        worn[vehicle] = held_out_paints(engine, out, vehicle, own, settings, {UNSEEN: STRONGEST}, before)
    return worn


def _other_places(vehicle: VehicleChoice, weathers: Sequence[str], views: HeldOut, count: int) -> list[Place]:
    """Places in which other objects alone are looked at: so many of a town of their own, a view of each."""
    there = views.one_a_place(count, TEST["beside the vehicle, of hardened detectors"])
    return held_out_places([vehicle], weathers, there) if count else []


def _figures(
    engine: Engine,
    study: Study,
    more: Study,
    held_out: Iterable[str],
    measures: Measures,
    before: Chosen,
    after: Chosen,
    cost: Cost,
    data: Sequence[Path],
) -> Figures:
    """All figures, from what both detectors found and from the cards of the hardening.

    Args:
        more: of places in which other objects alone are looked at.
    """
    names, held = (before[1].name, after[1].name), set(held_out)
    gains = [gains_of(entry, *names, sorted(held & set(entry.camouflages)), measures) for entry in study.entries]
    others = [_other_classes(engine, entry, before, after) for entry in study.entries]
    other_places = {entry.weathers: _other_classes(engine, entry, before, after) for entry in more.entries}
    return Figures(*names, gains, others, cost, _unmet(study, data), other_places)


def recipe_of(
    engine: Engine,
    detector: str,
    data: Sequence[Path],
    attacked: Sequence[Path],
    camouflages: Sequence[Path],
    settings: HardenSettings,
    out: Path,
    command: str,
) -> Artifact:
    """A detector hardened on data sets, to be made.

    Args:
        attacked: those of ``data`` that each round's camouflages are made on.
        camouflages: to train on beside them.
    """
    options = {
        "detector": detector, "datasets": [str(one.absolute()) for one in data],
        "attacked": [str(one.absolute()) for one in attacked],
        "camouflages": [str(one.absolute()) for one in camouflages],
        "settings": settings.model_dump(mode="json"), "command": command,
    }  # fmt: skip
    return recipes.hardened(detector, data, identity_of(hardening(options, out, engine.machine)), options)


def link_weights(folder: Path, out: Path) -> Path:
    """Let a hardened detector be found in ``out``; returns its weights in the store."""
    card = next(folder.glob("hardened-*.json"))
    made = [card.with_suffix(suffix) for suffix in (".onnx", ".safetensors", ".pth", "", ".names", ".json")]
    there = [path for path in made if path.exists()]
    for path in there:
        link(out / path.name, path)
    return there[0]


def _refuse_trained(candidates: Sequence[Candidate], trained: Iterable[Path]) -> None:
    """Refuse to judge by a camouflage that is trained on."""
    known = {file_digest(load_camouflage(path)[1]): path for path in trained}
    for candidate in candidates:
        if path := known.get(file_digest(candidate.path.with_suffix(".png"))):
            raise RaucaError(f"{candidate.path}: the same UV map as {path}; what is trained on cannot be held out")


def _vehicles(
    candidates: Sequence[Candidate], data: Sequence[Path], views: Sequence[Dataset], unseen: Sequence[VehicleChoice]
) -> Mapping[VehicleChoice, list[Candidate]]:
    """The vehicles of the held-out camouflages, each with a data set to train on; views show them or the unseen."""
    first = {read_plan(folder).atlas_id: Dataset(folder).vehicle_folder for folder in reversed(data)}
    known, remedy = list(map(read_vehicle_choice, first.values())), "add a data set of that vehicle with --data"
    chosen = match(candidates, known, everyone=False, remedy=remedy)
    atlases = {vehicle.atlas_id for vehicle in (*chosen, *unseen)}
    for folder in (dataset.folder for dataset in views if dataset.plan.atlas_id not in atlases):
        raise RaucaError(f"{folder}: views of a vehicle that no held-out camouflage fits; give views of that one")
    shown = {dataset.plan.atlas_id for dataset in views}
    for vehicle in (one for one in unseen if views and one.atlas_id not in shown):
        raise RaucaError(f"--views: none shows {vehicle.name}, which is held out; give views of it, too")
    return chosen


def _told_of_budgets(settings: HardenSettings, measures: Measures) -> str:
    steps = ", ".join(f"{budget}x ({budget * settings.attack_budget} steps)" for budget in measures.budgets)
    return f"{steps}, {measures.restarts} restarts" if steps else "none"


def _other_classes(engine: Engine, entry: Entry, before: Chosen, after: Chosen) -> OtherClasses:
    """Of both detectors on the views of an entry, with their vehicle and without it."""
    assert entry.views is not None
    frames = [row.id for row in entry.results.frames]
    empty = recipes.vacant(recipes.views_in(entry.views.resolve()), frames)
    kept = DetectionSettings(entry.category)
    wanted = [recipes.detections(empty, detector, typed, kept, frames) for typed, detector in (before, after)]
    one, other = (detections_in(*pair) for pair in zip(wanted, engine.make(*wanted), strict=True))
    pictures = pictures_in(engine.make(empty)[0], frames)
    return other_classes_of(entry, before[1].name, after[1].name, pictures, (one, other))


def _told_of_weights(weights: Path) -> dict[str, object]:
    """How much of what was learnt they hold, where they were taken back at all."""
    against = read_any_card(weights.with_suffix(".json"))[0].hardened
    share = against.get("share_of_weights")
    if share is None:
        return {}
    decided = f"{against['agreed']} of {against['objects']} other objects as before"
    return {"share of what was learnt": f"{share:.0%}", "in the places that decided it": decided}


def _unmet(study: Study, data: Sequence[Path]) -> frozenset[str]:
    """Sets of weathers of which no data set that was trained on has any."""
    met = {weather.name for folder in data for weather in read_plan(folder).weathers}
    return frozenset(e.weathers for e in study.entries if not met & {row.weather for row in e.results.frames})


def _origins(
    worn: Mapping[VehicleChoice, Mapping[str, Path]], held_out: Iterable[str], measures: Measures
) -> dict[str, str]:
    """How each paint was made, for the report."""
    made = {NORMAL: "the vehicle's own paint", RANDOM: "random cells, optimized against nothing"}
    for label, path in (pair for some in worn.values() for pair in some.items()):
        record, _ = load_camouflage(path)
        steps, against, seed = (record.made.get(name, "?") for name in ("steps", "detector", "seed"))
        told = f"{record.method}, {steps} steps against {against}, seed {seed}"
        known = "held out; " if label in held_out or label.startswith(METHOD) or label == UNSEEN else ""
        budget = f"the strongest of {measures.restarts} restarts; its last part: "
        made.setdefault(label, (known or budget) + told)
    return made
