"""Judging paints: all rendered on all views, or composed on pictures, shown to all detectors behind every defence."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..contract import Dataset, RaucaError
from . import recipes
from .artifact import Artifact, plain_label
from .candidates import NORMAL, VehicleChoice
from .defences import NO_DEFENCE, Defence, make_defence
from .detecting import detections_in, pictures_in
from .detection_cache import DetectionSettings
from .detectors import Chosen
from .engine import Engine
from .scores import tabulate
from .store import link
from .study import FILE_NAME, Entry, Study, save_study


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


@dataclass(frozen=True)
class _Run:
    """Views seen through a defence.

    Attributes:
        folder: of the views.
        frames: ids of those that show the vehicle; ``dropped`` do not.
        images: by paint, as they were rendered; ``seen``, as the defence leaves them.
        detections: by paint and detector.
    """

    place: Place
    folder: Path
    frames: Sequence[str]
    dropped: tuple[str, ...]
    images: Mapping[str, Artifact]
    defence: Defence
    seen: Mapping[str, Artifact]
    detections: Mapping[str, Mapping[str, Artifact]]


def judge(
    engine: Engine,
    out: Path,
    places: Sequence[Place],
    paints: Mapping[VehicleChoice, Mapping[str, Path]],
    judges: Judges,
    command: str,
) -> Study:
    """Show all paints on all views, detect in them behind every defence, and write ``out/study.json``.

    Args:
        paints: of each vehicle, camouflages (JSON) by label; its own paint comes before them.
    """
    folders = engine.make(*(place.views for place in places))
    runs = [
        run
        for place, folder in zip(places, folders, strict=True)
        for run in _runs(place, folder, paints[place.vehicle], judges)
    ]
    engine.make(*(images for run in runs for images in run.images.values()))
    engine.make(*(one for run in runs for found in run.detections.values() for one in found.values()))
    entries = []
    for run in runs:
        entries.append(_entry(engine, out, run, paints[run.place.vehicle]))
        save_study(out / FILE_NAME, command, entries)
    return Study(command, tuple(entries))


def _runs(place: Place, folder: Path, paints: Mapping[str, Path], judges: Judges) -> list[_Run]:
    """What is to be made of a place, one for each defence."""
    wanted = set(place.views.options["frames"])
    every = [frame for frame in Dataset(folder).frames() if not wanted or frame.id in wanted]
    frames = [frame.id for frame in every if frame.box_xyxy is not None]
    dropped = tuple(frame.id for frame in every if frame.box_xyxy is None)
    if not frames:
        raise RaucaError(f"{folder}: none of its {len(every)} frames shows the vehicle; nothing to evaluate")
    images = {NORMAL: place.views}
    pictured = all(frame.pictured for frame in every)
    for label, path in paints.items():
        worn = recipes.camouflage_in(path, label)
        make = recipes.composed if pictured else recipes.renders
        images[label] = make(place.views, worn, frames)
    category, runs = place.vehicle.category, []
    for defence in judges.defences:
        plain = defence.name == NO_DEFENCE
        seen = images if plain else {name: recipes.defended(one, defence, frames) for name, one in images.items()}
        detections = {
            paint: {
                detector.name: recipes.detections(one, detector, typed, DetectionSettings(category), frames)
                for typed, detector in judges.detectors[category]
            }
            for paint, one in seen.items()
        }
        runs.append(_Run(place, folder, frames, dropped, images, defence, seen, detections))
    return runs


def _entry(engine: Engine, out: Path, run: _Run, camouflages: Mapping[str, Path]) -> Entry:
    """Compute results from what was found, and write them."""
    name, vehicle = run.place.name, run.place.vehicle
    home = out / vehicle.name / plain_label(name)
    link(home / "views", run.folder)
    for paint in camouflages:
        link(home / "renders" / paint, engine.make(run.images[paint])[0])
    folder = home / re.sub(r"[^A-Za-z0-9.]+", "-", run.defence.name)
    paints = {paint: pictures_in(place, run.frames) for paint, place in engine.make_named(run.seen).items()}
    caches = {
        paint: {detector: detections_in(some[detector], place) for detector, place in engine.make_named(some).items()}
        for paint, some in run.detections.items()
    }
    results = tabulate(Dataset(run.folder), paints, caches, folder, run.defence.name, run.dropped)
    told = (name, run.defence.name, vehicle.name, vehicle.category)
    return Entry(*told, results, folder, run.folder, dict(camouflages))
