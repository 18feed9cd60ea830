"""The evaluation protocol: held-out views of each vehicle, every paint rendered there by Cycles, every defence, AP@0.5.

Folder of a study, run again to resume; every step only makes what is missing::

    study.json                                       what was evaluated, written after each result
    camouflages/<vehicle>/<label>.json, .png         copies of the camouflages
    <vehicle>/<weathers>/views/                      data set of held-out views
    <vehicle>/<weathers>/frames.txt                  which of its frames are evaluated
    <vehicle>/<weathers>/renders/<label>/            the same views in camouflage
    <vehicle>/<weathers>/<defence>/results.json      with detections/, and images/ after the defence
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from pipelines.console import progress_bar
from pipelines.evaluate import render_camouflages
from rauca_core.attack import random_camouflage
from rauca_core.contract import (
    Dataset,
    MakeDataset,
    Plan,
    Progress,
    RenderCamouflages,
    VehicleSource,
    balanced_frames,
    find_preset,
    frame_states,
    load_vehicle,
)
from rauca_core.contract.assets import assets_folder
from rauca_core.contract.files import write_bytes
from rauca_core.detect import Detector
from rauca_core.runtime.blender import run_blender
from rauca_core.runtime.folder_lock import alone_in
from rauca_core.runtime.images import read_image
from rauca_core.study import DetectionSettings, reference_images
from rauca_core.study import measure as measure_views
from rauca_core.study.contestants import NORMAL, RANDOM, Contestant, VehicleChoice, check_vehicle, keep_copy
from rauca_core.study.defences import Defence
from rauca_core.study.images_of import ImageOf
from rauca_core.study.renders import RenderRecord, discard_damaged
from rauca_core.study.study import FILE_NAME, Entry, save_study
from rauca_core.study.views import HeldOut

FRAMES = "frames.txt"
PRESETS = {"seen": "enhanced", "unseen": "unseen"}  # the paper's weathers of training, and 16 others


@dataclass(frozen=True)
class RandomPaint:
    """The random baseline: seed, and side of a cell in texels."""

    seed: int = 1
    cell: int = 8


@dataclass(frozen=True)
class Request:
    """What a study is asked to do; everything in it was checked.

    Attributes:
        command: that asks for it, as typed.
        out: the study's folder.
        contestants: camouflages of each vehicle.
        weathers: ``seen``, ``unseen``, or preset names or files; not used with ``datasets``.
        datasets: of each vehicle: rendered views to evaluate on instead of making some.
        detectors: by category of vehicle.
        random: also evaluate in random paint.
        scene: the .blend file that ``datasets`` were made in, if they were.
    """

    command: str
    out: Path
    contestants: Mapping[VehicleChoice, Sequence[Contestant]]
    detectors: Mapping[str, Sequence[Detector]]
    defences: Sequence[Defence]
    weathers: Sequence[str]
    held_out: HeldOut = field(default_factory=HeldOut)
    datasets: Mapping[str, Sequence[Dataset]] = field(default_factory=dict)
    random: RandomPaint | None = None
    resamples: int = 1000
    device: str = "cpu"
    blender: Path | None = None
    scene: Path | None = None


@dataclass(frozen=True)
class Views:
    """Frames to evaluate on: those of the data set in ``source`` that ``ids`` names; ``folder`` takes the results."""

    weathers: str
    source: Path
    ids: tuple[str, ...]
    folder: Path

    @property
    def dataset(self) -> Dataset:
        return Dataset(self.source)

    def rendered(self, plan: Plan) -> bool:
        """Whether nothing is left to be rendered; with another plan there, Blender is to say what differs."""
        if not (self.source / "dataset.json").is_file():
            return False
        if replace(self.dataset.plan, name=plan.name, blender=plan.blender, device=plan.device) != plan:
            return False
        states = frame_states(self.source)
        return all(states.get(frame_id) in ("done", "occluded") for frame_id in self.ids)


def run_study(request: Request) -> list[Entry]:
    """Run or resume a study; returns its entries. Raises :class:`RaucaError` if another process is at work there."""
    entries: list[Entry] = []
    with alone_in(request.out):
        for vehicle, contestants in request.contestants.items():
            copies = _copies(request, vehicle, contestants)
            for views in _views(request, vehicle):
                _render(request, vehicle, views, copies)
                for defence in request.defences:
                    entries.append(_evaluate(request, vehicle, views, copies, defence))
                    save_study(request.out / FILE_NAME, request.command, entries)
    return entries


def _copies(request: Request, vehicle: VehicleChoice, contestants: Sequence[Contestant]) -> dict[str, Path]:
    """The study's own copies of a vehicle's camouflages by label, random paint first."""
    folder = request.out / "camouflages" / vehicle.name
    copies = {}
    if request.random is not None:
        copies[RANDOM] = folder / f"{RANDOM}.json"
        loaded = load_vehicle(vehicle.folder, read_image)
        random_camouflage(copies[RANDOM], loaded, seed=request.random.seed, cell=request.random.cell)
    return copies | {contestant.label: keep_copy(contestant, folder) for contestant in contestants}


def _views(request: Request, vehicle: VehicleChoice) -> Iterator[Views]:
    if request.datasets:
        for dataset in request.datasets.get(vehicle.atlas_id, ()):
            name = dataset.folder.resolve().name
            ids = tuple(frame.id for frame in dataset.frames())
            yield Views(name, dataset.folder, ids, request.out / vehicle.name / name)
        return
    for weathers in request.weathers:
        yield _held_out(request, vehicle, weathers)


def _held_out(request: Request, vehicle: VehicleChoice, weathers: str) -> Views:
    """Render the views of one weather set that are missing, in the vehicle's reference paint."""
    preset = PRESETS.get(weathers, weathers)
    name = Path(weathers).stem
    folder = request.out / vehicle.name / name
    held_out = request.held_out.fitted(load_vehicle(vehicle.folder, read_image).positions)
    plan = held_out.plan(vehicle.name, vehicle.atlas_id, find_preset(preset, assets_folder() / "weathers"))
    ids = tuple(balanced_frames(plan, held_out.frames))
    views = Views(name, folder / "views", ids, folder)
    check_vehicle(views.source, vehicle, "--out")
    if views.rendered(plan):
        return views
    _list_frames(folder, ids)
    job = MakeDataset(folder / "views", plan, VehicleSource(str(vehicle.folder)), request.scene, ids)
    with progress_bar(f"{vehicle.name}, {name}: rendering views") as move:
        run_blender(job, move, request.blender)
    return views


def _render(request: Request, vehicle: VehicleChoice, views: Views, copies: Mapping[str, Path]) -> None:
    """Render the views in every camouflage; Blender is not even started when all are there."""
    dataset, wanted = views.dataset, set(views.ids)
    frames = [frame.id for frame in dataset.frames() if frame.id in wanted]
    record = RenderRecord.of(dataset.plan, list(copies.values()))
    renders = views.folder / "renders"
    for label in copies:
        discard_damaged(renders / label, frames)
    if not copies or record.holds(renders, frames):
        return
    record.forget(renders)
    _list_frames(views.folder, views.ids)
    title = f"{vehicle.name}, {views.weathers}: re-rendering in camouflage"
    job = RenderCamouflages(views.source, renders, tuple(copies.values()), tuple(views.ids), scene=request.scene)
    render_camouflages(job, request.blender, title)
    record.save(renders)


def _evaluate(
    request: Request, vehicle: VehicleChoice, views: Views, copies: Mapping[str, Path], defence: Defence
) -> Entry:
    dataset = views.dataset
    paints: dict[str, Path | ImageOf] = {NORMAL: reference_images(dataset)}
    paints |= {label: views.folder / "renders" / label for label in copies}
    folder = views.folder / re.sub(r"[^A-Za-z0-9.]+", "-", defence.name)
    with progress_bar(f"{vehicle.name}, {views.weathers}, defence {defence.name}") as move:
        results = measure_views(
            dataset,
            paints,
            request.detectors[vehicle.category],
            folder,
            on_progress=lambda what, done, total: move(Progress(done, total, what)),
            settings=DetectionSettings(vehicle.category),
            resamples=request.resamples,
            defence=defence,
            only=views.ids,
            device=request.device,
        )
    return Entry(
        views.weathers,
        defence.name,
        vehicle.name,
        vehicle.category,
        results,
        folder,
        views.source,
        dict(copies),
    )


def _list_frames(folder: Path, ids: Sequence[str]) -> None:
    write_bytes(folder / FRAMES, ("\n".join(ids) + "\n").encode())
