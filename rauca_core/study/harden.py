"""Harden a detector and measure what it gained.

Folder, run again to go on; every step only makes what is missing::

    hardened-<name>.safetensors, .json      the result, loaded by its path (.onnx, if that was given): links into
    store/hardened/...                      round-<k>/ with the camouflage made against the detector of that round, and
                                            the detector after it
    adaptive/<vehicle>/                     a link to a camouflage made against the result
    study/                                  both detectors on held-out views, rendered by Cycles, as of `evaluate`
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Unpack

from ..attack import OptimizerSettings
from ..contract import Dataset, RaucaError, load_camouflage, read_plan
from ..contract.files import file_digest
from ..detect import Detector
from ..runtime.folder_lock import alone_in
from ..training.harden import identity_of
from ..training.hardenable import named_as
from ..training.settings import HardenSettings
from . import recipes
from .artifact import Artifact
from .candidates import NORMAL, RANDOM, Candidate, VehicleChoice, match, read_candidates, read_vehicle_choice
from .detectors import detectors_for
from .engine import Engine, Means, open_engine
from .evaluate import RandomPaint, given_places, held_out_places, keep_paints, open_views
from .harden_rounds import attack_settings, hardening
from .hardening import Gains, gains_of
from .judging import Judges, judge
from .makers import CAMOUFLAGE
from .store import link
from .study import Study
from .views import HeldOut, weather_sets

ADAPTIVE = "adaptive"
RESERVED = (NORMAL, RANDOM, ADAPTIVE)


@dataclass(frozen=True)
class Hardened:
    """What came of it.

    Attributes:
        weights: of the hardened detector.
        before, after: the detectors' names.
        study: both on held-out views.
        gains: one for each entry of the study.
        made: paint -> how it was made.
        facts: what was asked for, as a reader should see it.
    """

    weights: Path
    before: str
    after: str
    study: Study
    gains: list[Gains]
    made: dict[str, str]
    facts: dict[str, object]


def harden(
    detector: str,
    datasets: Sequence[Path | str],
    held_out: Sequence[Path | str],
    out: Path | str,
    *,
    camouflages: Sequence[Path | str] = (),
    settings: HardenSettings | None = None,
    adaptive_steps: int = 150,
    views: Sequence[Path | str] = (),
    weathers: Sequence[str] = ("seen",),
    held_out_views: HeldOut | None = None,
    command: str = "",
    **means: Unpack[Means],
) -> Hardened:
    """Fine-tune a detector on camouflages, fresh ones among them, and measure before and after on held-out ones.

    Args:
        detector: to harden, as `load_detector` takes it.
        datasets: with light maps, to train on; the first of each vehicle is what the adaptive attack uses.
        held_out: camouflages, ``FILE`` or ``LABEL=FILE``, to judge by; never trained on.
        camouflages: to train on beside those made on the way.
        adaptive_steps: of the attack on the result; 0 makes none.
        views: rendered views to judge on; made anew, in ``weathers``, when there are none.

    Raises:
        RaucaError: a mistake, before any work; a loss that is not finite; a stop.
    """
    out, chosen = Path(out), settings or HardenSettings.make()
    data, trained = [Path(one) for one in datasets], [Path(one) for one in camouflages]
    opened, sets = open_views(views), weather_sets(weathers)
    candidates = read_candidates(list(map(str, held_out)), RESERVED)
    if not candidates:
        raise RaucaError("--held-out: none given; a hardened detector is judged by camouflages it was not trained on")
    matched = _vehicles(candidates, data, opened)
    atlases = {vehicle.atlas_id for vehicle in matched}
    attacked = [one for one in data if read_plan(one).atlas_id in atlases]
    means.setdefault("threads", chosen.threads)
    engine = open_engine(out / "store", [*data, *(one.folder for one in opened)], **means)
    _refuse_trained(candidates, trained)
    recipe = recipe_of(engine, detector, data, attacked, trained, chosen, out, command)
    with alone_in(out):
        _refuse_trained(candidates, engine.store.place(recipe).glob("round-*/attack/camouflage.json"))
        (folder,) = engine.make(recipe)
        _refuse_trained(candidates, folder.glob("round-*/attack/camouflage.json"))
        weights = link_weights(folder, out)
        both = detectors_for([detector, named_as(detector, weights)], [one.category for one in matched], engine.machine)
        (_, before), (typed, after) = next(iter(both.values()))
        asked = attack_settings(chosen, ADAPTIVE, adaptive_steps or 1, ADAPTIVE, engine.store.folder / "taps")
        adaptive = _adaptive(engine, out, matched, data, asked, (typed, after)) if adaptive_steps else {}
        paints = {}
        for vehicle, some in matched.items():
            worn = {one.label: one.path for one in some}
            worn |= {ADAPTIVE: adaptive[vehicle]} if adaptive else {}
            paints[vehicle] = keep_paints(engine, out / "study", vehicle, worn, RandomPaint())
        new = held_out_views or HeldOut(48)
        places = given_places(opened, matched, None) if opened else held_out_places(matched, sets, new)
        study = judge(engine, out / "study", places, paints, Judges(both), command)
    labels = {vehicle.name: [one.label for one in some] for vehicle, some in matched.items()}
    gains = [gains_of(entry, before.name, after.name, labels[entry.vehicle]) for entry in study.entries]
    facts = {
        "detector": Path(detector).name,
        "data sets": ", ".join(folder.name for folder in data),
        "camouflages trained on": ", ".join(load_camouflage(path)[0].name for path in trained) or "none given",
        **chosen.model_dump(mode="json", exclude={"threads", "memory_mb"}),
        "adaptive attack, steps": adaptive_steps,
    }
    origins = _origins(candidates, next(iter(adaptive.values()), None))
    return Hardened(out / weights.name, before.name, after.name, study, gains, origins, facts)


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
    made = [card.with_suffix(suffix) for suffix in (".onnx", ".safetensors", ".names", ".json")]
    there = [path for path in made if path.is_file()]
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
    candidates: Sequence[Candidate], data: Sequence[Path], views: Sequence[Dataset]
) -> Mapping[VehicleChoice, list[Candidate]]:
    """The vehicles of the held-out camouflages, each with a data set to train on."""
    first = {read_plan(folder).atlas_id: Dataset(folder).vehicle_folder for folder in reversed(data)}
    known, remedy = list(map(read_vehicle_choice, first.values())), "add a data set of that vehicle with --data"
    chosen = match(candidates, known, everyone=False, remedy=remedy)
    atlases = {vehicle.atlas_id for vehicle in chosen}
    for folder in (dataset.folder for dataset in views if dataset.plan.atlas_id not in atlases):
        raise RaucaError(f"{folder}: views of a vehicle that no held-out camouflage fits; give views of that one")
    return chosen


def _adaptive(
    engine: Engine,
    out: Path,
    vehicles: Iterable[VehicleChoice],
    data: Sequence[Path],
    asked: OptimizerSettings,
    hardened: tuple[str, Detector],
) -> dict[VehicleChoice, Path]:
    """A camouflage against the result for each vehicle."""
    firsts = {one: next(folder for folder in data if read_plan(folder).atlas_id == one.atlas_id) for one in vehicles}
    paints = [recipes.paint(recipes.views_in(folder), asked, [hardened]) for folder in firsts.values()]
    made = dict(zip(firsts, engine.make(*paints), strict=True))
    for vehicle, folder in made.items():
        link(out / ADAPTIVE / vehicle.name, folder)
    return {vehicle: folder / CAMOUFLAGE for vehicle, folder in made.items()}


def _origins(candidates: Sequence[Candidate], adaptive: Path | None) -> dict[str, str]:
    """How each paint was made, for the report."""

    def told(path: Path) -> str:
        record, _ = load_camouflage(path)
        steps, against, seed = (record.made.get(name, "?") for name in ("steps", "detector", "seed"))
        return f"{record.method}, {steps} steps against {against}, seed {seed}"

    made = {NORMAL: "the vehicle's own paint", RANDOM: "random cells, optimized against nothing"}
    made |= {one.label: f"held out; {told(one.path)}" for one in candidates}
    return made | ({ADAPTIVE: f"made after hardening; {told(adaptive)}"} if adaptive else {})
