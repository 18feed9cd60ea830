"""The evaluation: held-out views of each vehicle, every paint rendered there by Cycles, every defence, AP@0.5.

Of pictures from elsewhere nothing can be rendered: paints are composed on them by their light maps, which the name of
every result tells, and they are evaluated in studies of their own.

Folder of a study; run again to resume, every step only makes what is missing::

    study.json                                       what was evaluated, written after each result
    camouflages/<vehicle>/<label>.json, .png         copies of the camouflages
    <vehicle>/<weathers>/<defence>/results.json
    <vehicle>/<weathers>/views, renders/<label>      links to the data set and its renders, which lie in
    store/<kind>/<label>-<digest>                    all that was made on the way
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Unpack

from ..attack.paint import Paint
from ..contract import Dataset, RaucaError
from ..contract.schema import Record
from ..detect import Detector
from ..runtime.folder_lock import alone_in
from . import recipes
from .artifact import digest_of
from .candidates import (
    NORMAL,
    RANDOM,
    Candidate,
    VehicleChoice,
    find_vehicles,
    keep_copy,
    match,
    read_candidates,
    read_vehicle_choice,
)
from .defences import NO_DEFENCE, make_defence
from .detectors import detectors_for
from .engine import Engine, Means, open_engine
from .judging import Judges, Place, judge
from .makers import CAMOUFLAGE
from .store import user_cache
from .study import Study
from .views import HeldOut, weather_sets, weather_views, weathers_named

AnyPaint = Paint | Path | str


@dataclass(frozen=True)
class RandomPaint(Record):
    """The random baseline: seed, and sides of a cell and of the map in texels."""

    seed: int = 1
    cell: int = 8
    size: int = 1024


def evaluate(
    paints: AnyPaint | Sequence[AnyPaint] = (),
    detectors: Detector | str | Sequence[Detector | str] = (),
    *,
    out: Path | str | None = None,
    vehicle: str | Sequence[str] = (),
    weathers: str | Sequence[str] = ("seen", "unseen"),
    frames: int | None = None,
    views: HeldOut | None = None,
    datasets: Sequence[Dataset | Path | str] = (),
    defences: str | Sequence[str] = (NO_DEFENCE,),
    random: RandomPaint | None = None,
    scene: Path | None = None,
    store: Path | None = None,
    command: str = "",
    **means: Unpack[Means],
) -> Study:
    """Measure AP@0.5 of detectors on held-out views of vehicles in their own paint and in camouflages.

    Args:
        paints: camouflages: in memory, or the paths of their JSON or PNG, or ``LABEL=PATH``.
        detectors: loaded ones, or names and files; every one that is ready if there are none.
        out: the study's folder; one in the user's cache, which other studies look into, if left out.
        vehicle: shipped names or vehicle folders; those that the camouflages fit if left out.
        weathers: sets of them: ``seen``, ``unseen``, ``both``, or presets by name or file.
        frames: per set of weathers; ``views.frames`` if left out.
        views: how held-out views are made.
        datasets: rendered views to evaluate on instead of making some, or pictures; they bring vehicle and weathers.
        defences: that images go through before detection.
        random: evaluate in random paint, too.
        scene: the .blend that ``datasets`` were made in, if they were.
        store: where views, renders and detections are kept; in ``out`` if left out.
        command: what was typed, for the report.
        means: see :class:`~rauca_core.study.engine.Means`: device, threads, blender, render_device, on_progress ...

    Raises:
        RaucaError: a mistake, before anything is rendered; another process at work in ``out``.
    """
    opened = open_views(datasets, pictures=True)
    held_out = views or HeldOut()
    held_out = held_out if frames is None else replace(held_out, frames=frames)
    asked = _listed(defences) or [NO_DEFENCE]
    with tempfile.TemporaryDirectory(prefix="rauca-") as scratch:
        given = [_on_disk(paint, Path(scratch), i) for i, paint in enumerate(_listed(paints))]
        candidates = read_candidates(given, (NORMAL,) if random is None else (NORMAL, RANDOM))
        vehicles = _vehicles(_listed(vehicle), opened)
        matched = match(candidates, vehicles, everyone=bool(vehicle or opened))
        if not matched:
            raise RaucaError("evaluate: nothing to evaluate; give camouflages, a data set or a --vehicle")
        named = {defence.name: defence for defence in map(make_defence, asked)}
        sets = [] if opened else weather_sets(_listed(weathers))
        folder = Path(out or user_cache() / "studies" / _name_of(candidates, sets, held_out, asked))
        around = [*(dataset.folder for dataset in opened), *(candidate.path for candidate in candidates)]
        engine = open_engine(store or (folder / "store" if out is not None else user_cache()), around, **means)
        chosen = detectors_for(_listed(detectors), [one.category for one in matched], engine.machine)
        with alone_in(folder):
            places = given_places(opened, matched, scene) if opened else held_out_places(matched, sets, held_out, scene)
            worn = {
                one: keep_paints(engine, folder, one, {candidate.label: candidate.path for candidate in some}, random)
                for one, some in matched.items()
            }
            return judge(engine, folder, places, worn, Judges(chosen, list(named.values())), command)


def held_out_places(
    vehicles: Iterable[VehicleChoice], weathers: Sequence[str], held_out: HeldOut, scene: Path | None = None
) -> list[Place]:
    """The held-out views of vehicles under sets of weathers, to be rendered in the vehicle's reference paint."""
    sets = {Path(name).stem: weathers_named(name) for name in weathers}
    return [
        Place(called, vehicle, views)
        for vehicle in vehicles
        for called, views in weather_views(vehicle, sets, held_out, scene).items()
    ]


def given_places(datasets: Sequence[Dataset], vehicles: Iterable[VehicleChoice], scene: Path | None) -> list[Place]:
    """Data sets of the vehicles that were rendered before, or of pictures, which are called composed."""
    return [
        Place(_called(dataset), vehicle, recipes.views_in(dataset.folder, scene))
        for vehicle in vehicles
        for dataset in datasets
        if dataset.plan.atlas_id == vehicle.atlas_id
    ]


def _called(dataset: Dataset) -> str:
    name = dataset.folder.absolute().name
    return f"{name}, composed" if dataset.require_rendered_or_pictured("detectors are judged on") else name


def open_views(folders: Sequence[Dataset | Path | str], pictures: bool = False) -> list[Dataset]:
    """Views to judge on.

    Args:
        pictures: take data sets of pictures, too, but not beside rendered ones.

    Raises:
        RaucaError: composed views, pictures beside rendered views, two data sets of one name on a vehicle.
    """
    opened = [one if isinstance(one, Dataset) else Dataset(Path(one)) for one in folders]
    seen: dict[tuple[str, str], Dataset] = {}
    first = None
    for dataset in opened:
        if not pictures:
            dataset.require_rendered("detectors are judged on")
        pictured = dataset.require_rendered_or_pictured("detectors are judged on")
        first = pictured if first is None else first
        if pictured != first:
            raise RaucaError(
                f"{dataset.folder}: pictures and rendered views in one study, whose averages would be of both; "
                "evaluate them apart, each into a folder of its own"
            )
        if seen.setdefault((dataset.plan.atlas_id, dataset.folder.absolute().name), dataset) is not dataset:
            raise RaucaError(f"{dataset.folder}: two data sets of one name; results are told apart by it, rename one")
    return opened


def keep_paints(
    engine: Engine, out: Path, vehicle: VehicleChoice, paints: Mapping[str, Path], random: RandomPaint | None
) -> dict[str, Path]:
    """A study's own copies of a vehicle's camouflages (JSON) by label, random paint first."""
    some = dict(paints)
    if random is not None:
        body = recipes.vehicle_in(vehicle.folder)
        (folder,) = engine.make(recipes.random_paint(body, random.size, random.seed, random.cell))
        some = {RANDOM: folder / CAMOUFLAGE, **some}
    return {label: keep_copy(label, path, out / "camouflages" / vehicle.name) for label, path in some.items()}


def _vehicles(named: Sequence[str], datasets: Sequence[Dataset]) -> list[VehicleChoice]:
    if not datasets:
        return find_vehicles(named)
    if named:
        raise RaucaError("--vehicle: a data set brings its own vehicle; drop one of the two")
    choices = {dataset.plan.atlas_id: read_vehicle_choice(dataset.vehicle_folder) for dataset in datasets}
    return list(choices.values())


def _on_disk(paint: AnyPaint, scratch: Path, number: int) -> str:
    """A camouflage as `read_candidates` takes it."""
    if not isinstance(paint, Paint):
        return str(paint)
    return str(paint.path or paint.save(scratch / str(number) / "camouflage.json"))


def _listed(given: Any) -> list[Any]:
    """One or several as a list."""
    return list(given) if isinstance(given, Sequence) and not isinstance(given, str) else [given]


def _name_of(candidates: Sequence[Candidate], sets: Sequence[str], held_out: HeldOut, defences: Sequence[str]) -> str:
    """Of a study without a folder: the same question comes back to the same one."""
    maps = [recipes.camouflage_in(one.path, one.label).digest for one in candidates]
    asked = {name: value for name, value in asdict(held_out).items() if value is not None}
    return digest_of([maps, list(sets), asked, list(defences)])
