"""Harden a detector and measure what it gained.

Folder, run again to go on; every step only makes what is missing::

    hardened-<name>.safetensors, .json      the result, loaded by its path: links into
    store/hardened/...                      round-<k>/ with the camouflage made against the detector of that round, and
                                            the detector after it
    adaptive/<vehicle>/                     a link to a camouflage made against the result
    study/                                  both detectors on held-out views, rendered by Cycles, as of `evaluate`
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..contract import Dataset, RaucaError, load_camouflage, read_plan
from ..contract.files import file_digest
from ..detect import load_detector
from ..runtime.folder_lock import alone_in
from ..training.harden import identity_of
from ..training.settings import HardenSettings
from . import recipes
from .candidates import (
    NORMAL,
    RANDOM,
    Candidate,
    VehicleChoice,
    match,
    read_candidates,
    read_vehicle_choice,
)
from .engine import Engine
from .evaluate import Judges, RandomPaint, given_places, held_out_places, judge, keep_paints
from .executors import Executor
from .harden_rounds import attack_settings, hardening
from .hardening import Gains, gains_of
from .job import Machine, OnProgress, quiet
from .makers import CAMOUFLAGE
from .measuring import Chosen, check_detectors
from .store import Store, link, store_around, user_cache
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
    resamples: int = 1000,
    device: str = "cpu",
    blender: Path | None = None,
    render_device: str = "cpu",
    executor: Executor | None = None,
    on_progress: OnProgress = quiet,
    command: str = "",
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
    data, opened, sets = [Path(one) for one in datasets], [Dataset(Path(one)) for one in views], weather_sets(weathers)
    if len({one.folder.absolute().name for one in opened}) != len(opened):
        raise RaucaError("--views: two folders of one name; results are told apart by it, rename one")
    candidates = _candidates(held_out)
    matched = _vehicles(candidates, data, opened)
    atlases = {vehicle.atlas_id for vehicle in matched}
    options = {
        "detector": detector, "datasets": [str(one.absolute()) for one in data],
        "attacked": [str(one.absolute()) for one in data if read_plan(one).atlas_id in atlases],
        "camouflages": [str(Path(one).absolute()) for one in camouflages],
        "settings": chosen.model_dump(mode="json"), "command": command,
    }  # fmt: skip
    machine = Machine(device, chosen.threads, blender, render_device)
    _refuse_trained(candidates, [Path(one) for one in camouflages])
    recipe = recipes.hardened(detector, data, identity_of(hardening(options, out, machine)), options)
    around = [place for one in (*data, *(d.folder for d in opened)) for place in store_around(one)]
    engine = Engine(Store(out / "store", [*around, user_cache()]), machine, on_progress, executor)
    with alone_in(out):
        _refuse_trained(candidates, engine.store.place(recipe).glob("round-*/attack/camouflage.json"))
        (folder,) = engine.make(recipe)
        _refuse_trained(candidates, folder.glob("round-*/attack/camouflage.json"))
        weights = next(folder.glob("hardened-*.safetensors"))
        for made in (weights, weights.with_suffix(".json")):
            link(out / made.name, made)
        both = [(name, load_detector(name, device=device)) for name in (detector, str(weights))]
        machine.with_detectors(one for _, one in both)
        adaptive = _adaptive(engine, out, matched, data, chosen, adaptive_steps, both[1]) if adaptive_steps else {}
        paints = {
            vehicle: keep_paints(engine, out / "study", vehicle, [*some, *adaptive.get(vehicle, ())], RandomPaint())
            for vehicle, some in matched.items()
        }
        for vehicle in matched:
            check_detectors([one for _, one in both], vehicle.category)
        places = given_places(opened, matched, None) if opened else held_out_places(
            matched, sets, held_out_views or HeldOut(48)
        )  # fmt: skip
        judges = Judges({vehicle.category: both for vehicle in matched}, resamples=resamples)
        study = judge(engine, out / "study", places, paints, judges, command)
    before, after = both[0][1].name, both[1][1].name
    labels = {vehicle.name: [one.label for one in some] for vehicle, some in matched.items()}
    gains = [gains_of(entry, before, after, labels[entry.vehicle]) for entry in study.entries]
    others = [one.path for some in adaptive.values() for one in some]
    facts = _facts(detector, data, [Path(one) for one in camouflages], chosen, adaptive_steps)
    return Hardened(out / weights.name, before, after, study, gains, _made(candidates, others), facts)


def _candidates(held_out: Sequence[Path | str]) -> list[Candidate]:
    candidates = read_candidates(list(map(str, held_out)), RESERVED)
    if not candidates:
        raise RaucaError("--held-out: none given; a hardened detector is judged by camouflages it was not trained on")
    return candidates


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
    for candidate in candidates:
        record = candidate.record
        if record.atlas_id not in first:
            raise RaucaError(
                f"{candidate.path}: made for {record.vehicle_name} (UV atlas {record.atlas_id}), which no data set "
                "shows; add one of that vehicle with --data"
            )
    chosen = match(candidates, [read_vehicle_choice(folder) for folder in first.values()], everyone=False)
    atlases = {vehicle.atlas_id for vehicle in chosen}
    for dataset in views:
        if dataset.plan.atlas_id not in atlases:
            raise RaucaError(
                f"{dataset.folder}: views of a vehicle that no held-out camouflage fits; give views of that one"
            )
    return chosen


def _adaptive(
    engine: Engine,
    out: Path,
    vehicles: Iterable[VehicleChoice],
    data: Sequence[Path],
    settings: HardenSettings,
    steps: int,
    hardened: Chosen,
) -> dict[VehicleChoice, list[Candidate]]:
    """A camouflage against the result for each vehicle."""
    asked = attack_settings(settings, ADAPTIVE, steps, ADAPTIVE, engine.store.folder / "taps")
    firsts = {one: next(d for d in data if read_plan(d).atlas_id == one.atlas_id) for one in vehicles}
    paints = [recipes.paint(recipes.views_in(d), asked, [hardened[1]], [hardened[0]]) for d in firsts.values()]
    made = {}
    for vehicle, folder in zip(firsts, engine.make(*paints), strict=True):
        link(out / ADAPTIVE / vehicle.name, folder)
        made[vehicle] = [Candidate(ADAPTIVE, folder / CAMOUFLAGE, load_camouflage(folder / CAMOUFLAGE)[0])]
    return made


def _made(candidates: Sequence[Candidate], adaptive: Sequence[Path]) -> dict[str, str]:
    """How each paint was made, for the report."""
    made = {NORMAL: "the vehicle's own paint", RANDOM: "random cells, optimized against nothing"}
    made |= {one.label: f"held out; {_origin(one.path)}" for one in candidates}
    if adaptive:
        made[ADAPTIVE] = f"made after hardening; {_origin(adaptive[0])}"
    return made


def _origin(path: Path) -> str:
    record, _ = load_camouflage(path)
    steps, against, seed = (record.made.get(name, "?") for name in ("steps", "detector", "seed"))
    return f"{record.method}, {steps} steps against {against}, seed {seed}"


def _facts(
    detector: str, data: Sequence[Path], camouflages: Sequence[Path], settings: HardenSettings, adaptive_steps: int
) -> dict[str, object]:
    return {
        "detector": Path(detector).name,
        "data sets": ", ".join(folder.name for folder in data),
        "camouflages trained on": ", ".join(load_camouflage(path)[0].name for path in camouflages) or "none given",
        **settings.model_dump(mode="json", exclude={"threads", "memory_mb"}),
        "adaptive attack, steps": adaptive_steps,
    }
