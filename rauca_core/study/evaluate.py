"""The evaluation: held-out views of each vehicle, every paint rendered there by Cycles, every defence, AP@0.5.

Folder of a study; run again to resume, every step only makes what is missing::

    study.json                                       what was evaluated, written after each result
    camouflages/<vehicle>/<label>.json, .png         copies of the camouflages
    <vehicle>/<weathers>/<defence>/results.json
    <vehicle>/<weathers>/views, renders/<label>      links to the data set and its renders, which lie in
    store/<kind>/<label>-<digest>                    all that was made on the way
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from ..attack.paint import Paint
from ..contract import Dataset, RaucaError, Scenery, balanced_frames, load_camouflage, load_vehicle
from ..detect import Detector
from ..runtime.folder_lock import alone_in
from ..runtime.images import read_image
from . import recipes
from .artifact import Artifact, digest_of, plain_label
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
from .defences import Defence, make_defence
from .defended import NO_DEFENCE
from .detection_cache import DetectionSettings
from .engine import Engine
from .executors import Executor
from .job import Machine, OnProgress, quiet
from .makers import CAMOUFLAGE, detections_in, pictures_in
from .measuring import Asked, Chosen, detectors_for, tabulate
from .scores import Bootstrap
from .store import Store, link, store_around, user_cache
from .study import FILE_NAME, Entry, Study, save_study
from .views import HeldOut, weather_sets, weathers_named

AnyPaint = Paint | Path | str


@dataclass(frozen=True)
class RandomPaint:
    """The random baseline: seed, and side of a cell in texels."""

    seed: int = 1
    cell: int = 8
    size: int = 1024


@dataclass(frozen=True)
class Place:
    """Views to evaluate on, under the name that tables give them."""

    name: str
    vehicle: VehicleChoice
    views: Artifact


@dataclass(frozen=True)
class Judges:
    """By whom, and how, images are judged.

    Attributes:
        detectors: by category of vehicle, each with what it was named by.
    """

    detectors: Mapping[str, Sequence[Chosen]]
    defences: Sequence[Defence] = field(default_factory=lambda: (make_defence(NO_DEFENCE),))
    resamples: int = 1000


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
    resamples: int = 1000,
    device: str = "cpu",
    threads: int | None = None,
    blender: Path | None = None,
    render_device: str = "cpu",
    scene: Path | None = None,
    store: Path | None = None,
    executor: Executor | None = None,
    on_progress: OnProgress = quiet,
    command: str = "",
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
        datasets: rendered views to evaluate on instead of making some; they bring vehicle and weathers.
        defences: that images go through before detection.
        random: evaluate in random paint, too.
        resamples: of the bootstrap behind the intervals.
        device: of all detectors.
        threads: of torch.
        blender: program; the bpy wheel if left out.
        render_device: of Cycles: cpu, gpu or auto.
        scene: the .blend that ``datasets`` were made in, if they were.
        store: where views, renders and detections are kept; in ``out`` if left out.
        executor: who makes them; this process if left out.
        on_progress: called with what is being done, and how far it is.
        command: what was typed, for the report.

    Raises:
        RaucaError: a mistake, before anything is rendered; another process at work in ``out``.
    """
    opened = [one if isinstance(one, Dataset) else Dataset(Path(one)) for one in datasets]
    held_out = views or HeldOut()
    held_out = held_out if frames is None else replace(held_out, frames=frames)
    asked = _listed(defences)
    with tempfile.TemporaryDirectory(prefix="rauca-") as scratch:
        given = [_on_disk(paint, Path(scratch), i) for i, paint in enumerate(_listed(paints))]
        candidates = read_candidates(given, (NORMAL,) if random is None else (NORMAL, RANDOM))
        vehicles = _vehicles(_listed(vehicle), opened)
        matched = match(candidates, vehicles, everyone=bool(vehicle or opened))
        if not matched:
            raise RaucaError("evaluate: nothing to evaluate; give camouflages, a data set or a --vehicle")
        named = {defence.name: defence for defence in map(make_defence, asked or [NO_DEFENCE])}
        sets = [] if opened else weather_sets(_listed(weathers))
        _distinct(opened)
        chosen = detectors_for(_listed(detectors), [one.category for one in matched], device)
        cache = user_cache()
        folder = Path(out) if out is not None else cache / "studies" / _name_of(candidates, sets, held_out, asked)
        paths = [*(dataset.folder for dataset in opened), *(candidate.path for candidate in candidates)]
        around = [place for path in paths for place in store_around(path)]
        kept = Store(store or (folder / "store" if out is not None else cache), [*around, cache])
        machine = Machine(device, threads, blender, render_device).with_detectors(
            d for some in chosen.values() for _, d in some
        )
        engine = Engine(kept, machine, on_progress, executor)
        with alone_in(folder):
            places = given_places(opened, matched, scene) if opened else held_out_places(matched, sets, held_out, scene)
            worn = {one: keep_paints(engine, folder, one, some, random) for one, some in matched.items()}
            judges = Judges(chosen, list(named.values()), resamples)
            return judge(engine, folder, places, worn, judges, command)


def held_out_places(
    vehicles: Iterable[VehicleChoice], weathers: Sequence[str], held_out: HeldOut, scene: Path | None = None
) -> list[Place]:
    """The held-out views of vehicles under sets of weathers, to be rendered in the vehicle's reference paint."""
    places = []
    for vehicle in vehicles:
        body = recipes.vehicle_in(vehicle.folder)
        fitted = held_out.fitted(load_vehicle(vehicle.folder, read_image).positions)
        for name in weathers:
            plan = fitted.plan(vehicle.name, vehicle.atlas_id, weathers_named(name))
            plan = plan if scene is None else replace(plan, scenery=Scenery.of_file(scene))
            frames, called = balanced_frames(plan, fitted.frames), Path(name).stem
            views = recipes.data_set(f"{vehicle.name}-{called}", plan, body, frames, scene)
            places.append(Place(called, vehicle, views))
    return places


def given_places(datasets: Sequence[Dataset], vehicles: Iterable[VehicleChoice], scene: Path | None) -> list[Place]:
    """Data sets of the vehicles that were rendered before."""
    return [
        Place(dataset.folder.absolute().name, vehicle, recipes.views_in(dataset.folder, scene))
        for vehicle in vehicles
        for dataset in datasets
        if dataset.plan.atlas_id == vehicle.atlas_id
    ]


def keep_paints(
    engine: Engine, out: Path, vehicle: VehicleChoice, candidates: Sequence[Candidate], random: RandomPaint | None
) -> dict[str, Path]:
    """A study's own copies of a vehicle's camouflages by label, random paint first."""
    some = list(candidates)
    if random is not None:
        body = recipes.vehicle_in(vehicle.folder)
        (folder,) = engine.make(recipes.random_paint(body, random.size, random.seed, random.cell))
        some.insert(0, Candidate(RANDOM, folder / CAMOUFLAGE, load_camouflage(folder / CAMOUFLAGE)[0]))
    return {one.label: keep_copy(one, out / "camouflages" / vehicle.name) for one in some}


def judge(
    engine: Engine,
    out: Path,
    places: Sequence[Place],
    paints: Mapping[VehicleChoice, Mapping[str, Path]],
    judges: Judges,
    command: str,
) -> Study:
    """Render all paints on all views, detect in them behind every defence, and write ``out/study.json``.

    Args:
        paints: of each vehicle, camouflages (JSON) by label; its own paint comes before them.
    """
    folders = engine.make(*(place.views for place in places))
    wanted = [_images(place, folder, paints[place.vehicle]) for place, folder in zip(places, folders, strict=True)]
    engine.make(*(images for _, of_paint in wanted for images in of_paint.values()))
    runs = [
        _Run(engine, out, place, folder, frames, images, defence, judges.detectors[place.vehicle.category])
        for place, folder, (frames, images) in zip(places, folders, wanted, strict=True)
        for defence in judges.defences
    ]
    engine.make(*(seen for run in runs for of_paint in run.detections().values() for seen in of_paint.values()))
    entries = []
    for run in runs:
        entries.append(run.entry(paints[run.place.vehicle], judges.resamples))
        save_study(out / FILE_NAME, command, entries)
    return Study(command, tuple(entries))


@dataclass(frozen=True)
class _Run:
    """Views seen through a defence; ``images`` are by paint, of ``frames`` that show the vehicle."""

    engine: Engine
    out: Path
    place: Place
    folder: Path
    frames: Sequence[str]
    images: Mapping[str, Artifact]
    defence: Defence
    detectors: Sequence[Chosen]

    @property
    def settings(self) -> DetectionSettings:
        return DetectionSettings(self.place.vehicle.category)

    def seen(self) -> dict[str, Artifact]:
        """What detectors are shown, by paint."""
        if self.defence.name == NO_DEFENCE:
            return dict(self.images)
        return {paint: recipes.defended(one, self.defence, self.frames) for paint, one in self.images.items()}

    def detections(self) -> dict[str, dict[str, Artifact]]:
        """What they find, by paint and detector."""
        return {
            paint: {
                detector.name: recipes.detections(images, detector, typed, self.settings, self.frames)
                for typed, detector in self.detectors
            }
            for paint, images in self.seen().items()
        }

    def entry(self, camouflages: Mapping[str, Path], resamples: int) -> Entry:
        """Compute results from what was found, and write them."""
        place, vehicle, engine = self.place, self.place.vehicle, self.engine
        home = self.out / vehicle.name / plain_label(place.name)
        link(home / "views", self.folder)
        for paint in camouflages:
            link(home / "renders" / paint, engine.make(self.images[paint])[0])
        folder = home / re.sub(r"[^A-Za-z0-9.]+", "-", self.defence.name)
        ((*pictures,), dataset) = engine.make(*self.seen().values()), Dataset(self.folder)
        paints = {paint: pictures_in(one, self.frames) for paint, one in zip(self.images, pictures, strict=True)}
        caches = {
            paint: {name: detections_in(one, engine.make(one)[0]) for name, one in some.items()}
            for paint, some in self.detections().items()
        }
        wanted = set(place.views.options["frames"])
        there = [frame.id for frame in dataset.frames() if not wanted or frame.id in wanted]
        dropped = tuple(frame for frame in there if frame not in set(self.frames))
        asked = Asked(self.settings, Bootstrap(resamples, 0), self.defence.name, dropped)
        results = tabulate(dataset, paints, caches, folder, asked)
        told = (place.name, self.defence.name, vehicle.name, vehicle.category)
        return Entry(*told, results, folder, self.folder, dict(camouflages))


def _images(place: Place, folder: Path, paints: Mapping[str, Path]) -> tuple[list[str], dict[str, Artifact]]:
    """The frames that show the vehicle, and where their images come from in each paint."""
    wanted, every = set(place.views.options["frames"]), Dataset(folder).frames()
    some = [frame for frame in every if not wanted or frame.id in wanted]
    frames = [frame.id for frame in some if frame.box_xyxy is not None]
    if not frames:
        raise RaucaError(f"{folder}: none of its {len(some)} frames shows the vehicle; nothing to evaluate")
    worn = {
        label: recipes.renders(place.views, recipes.camouflage_in(path, label), frames)
        for label, path in paints.items()
    }
    return frames, {NORMAL: place.views, **worn}


def _vehicles(named: Sequence[str], datasets: Sequence[Dataset]) -> list[VehicleChoice]:
    if not datasets:
        return find_vehicles(named)
    if named:
        raise RaucaError("--vehicle: a data set brings its own vehicle; drop one of the two")
    choices = {dataset.plan.atlas_id: read_vehicle_choice(dataset.vehicle_folder) for dataset in datasets}
    return list(choices.values())


def _distinct(datasets: Sequence[Dataset]) -> None:
    seen: dict[tuple[str, str], Dataset] = {}
    for dataset in datasets:
        if seen.setdefault((dataset.plan.atlas_id, dataset.folder.absolute().name), dataset) is not dataset:
            raise RaucaError(f"{dataset.folder}: two data sets of one name; results are told apart by it, rename one")


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
    return digest_of([maps, list(sets), asdict(held_out), list(defences)])
