"""The kinds of artifacts: what each holds, who makes it, and how that one knows that its work is done."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ..attack import Renderer, make_settings, random_camouflage, run_optimization
from ..contract import (
    Dataset,
    ImportVehicle,
    MakeDataset,
    Plan,
    Progress,
    RaucaError,
    RenderCamouflages,
    VehicleSource,
    frame_states,
    load_camouflage,
    load_vehicle,
    save_camouflage,
)
from ..contract.files import file_digest, png_bytes, write_bytes, write_json
from ..contract.schema import Fields
from ..contract.system import cores
from ..runtime.blender import run_blender, run_blenders
from ..runtime.devices import threads
from ..runtime.images import is_whole, read_image
from ..training.extractor_fit import FINISHED, PUBLISHED_WEIGHTS, fit_published
from .artifact import Artifact
from .camouflaged import wearer
from .defences import make_defence
from .defences.interface import to_pixels
from .detecting import detect_in, detections_in, image_of, image_tensor, pictures_in, read_frame_image, source_of
from .harden_rounds import run_hardening
from .interpolated import run_interpolation
from .job import Job, Machine, steps_told
from .ranking import FILE_NAME as RANKING
from .ranking import Ranking, rank_camouflages
from .vacant import without_vehicle

CAMOUFLAGE = "camouflage.json"
MOST_BLENDERS, IMAGES_A_BLENDER = 4, 8


def make_vehicle(job: Job) -> None:
    """Read a vehicle from another format, in Blender."""
    given = Fields(job.artifact.options["source"], job.artifact.name)
    run_blender(ImportVehicle(job.folder, VehicleSource.from_json(given)), job.report, job.machine.blender)


def has_views(artifact: Artifact, folder: Path) -> bool:
    """Whether none of the wanted frames is left to be rendered."""
    if not (folder / "dataset.json").is_file():
        return False
    states = frame_states(folder)
    return all(states.get(frame) in ("done", "occluded") for frame in artifact.options["frames"])


def make_views(job: Job) -> None:
    """Render the frames of a data set that are missing, in Blender; a finished one is never rendered again."""
    wanted = job.artifact
    fields = {**wanted.settings["plan"], "name": wanted.label, "blender": ""}
    plan = Plan.from_json(Fields(fields, wanted.name))
    vehicle, frames = VehicleSource(str(job.inputs[0])), tuple(wanted.options["frames"])
    device, workers = job.machine.render_device, _blenders(len(frames), job.machine)
    asked = MakeDataset(job.folder, plan, vehicle, _scene(wanted), frames, workers=workers, device=device)
    run_blender(asked, job.report, job.machine.blender)


def make_part(job: Job) -> None:
    """Some frames of a data set as a data set of their own; files are linked where the disk can."""
    whole, folder = job.inputs[0], job.folder
    shutil.copytree(whole / "vehicle", folder / "vehicle", dirs_exist_ok=True)
    for frame in job.artifact.settings["frames"]:
        if (whole / "frames" / frame).is_dir():  # frames that hide the vehicle were left out
            source, target = whole / "frames" / frame, folder / "frames" / frame
            shutil.copytree(source, target, copy_function=_link, dirs_exist_ok=True)
    shutil.copy2(whole / "dataset.json", folder)  # last: with it, all are there


def make_extractor(job: Job) -> None:
    """Train the published extractor of light."""

    def tell(told: Any) -> None:
        job.report(Progress(told.epoch, told.epochs, f"error {told.error:.4f}"))

    epochs, machine = job.artifact.settings["epochs"], job.machine
    fit_published(job.inputs[0], job.folder, epochs, threads=machine.threads, on_epoch=tell, device=machine.device)


def has_camouflage(artifact: Artifact, folder: Path) -> bool:
    """Whether there is one, and neither of its files is damaged."""
    try:
        _, image = load_camouflage(folder / CAMOUFLAGE)
    except RaucaError:
        return False
    return is_whole(image)


def make_paint(job: Job) -> None:
    """Optimize, or go on where an earlier process stopped."""
    options = job.artifact.options
    settings = make_settings(**{**options["settings"], "threads": job.machine.threads})
    if len(job.inputs) > 1:
        settings = settings.model_copy(update={"extractor": job.inputs[1] / PUBLISHED_WEIGHTS})
    named = zip(job.artifact.settings["detectors"], options["detectors"], strict=True)
    detectors = [job.machine.detector(fingerprint, typed) for fingerprint, typed in named]
    data, folder = Dataset(job.inputs[0]), job.folder
    step, view = steps_told(job.report)
    run_optimization(data, detectors, settings, folder, step, view, job.machine.processes)


def make_random(job: Job) -> None:
    """Random paint, the baseline of all others."""
    random_camouflage(job.folder / CAMOUFLAGE, load_vehicle(job.inputs[0], read_image), **job.artifact.settings)


def has_renders(artifact: Artifact, folder: Path) -> bool:
    """Whether the images of all wanted frames are there, and none is damaged."""
    return all(is_whole(folder / f"{frame}.png") for frame in artifact.options["frames"])


def rendered_together(artifact: Artifact) -> object:
    """One Blender renders the same frames in several camouflages."""
    return artifact.inputs[0].digest, tuple(artifact.options["frames"]), str(artifact.settings)


def make_renders(*jobs: Job) -> None:
    """Render views in camouflages, in Blender, by Cycles and never by the neural renderer."""
    first, frames = jobs[0], jobs[0].artifact.options["frames"]
    with tempfile.TemporaryDirectory(prefix="rauca-") as temporary:
        paints: list[Path] = []
        for job in jobs:
            record, image = load_camouflage(job.inputs[1])
            paints.append(Path(temporary) / f"{len(paints)}.json")
            save_camouflage(paints[-1], replace(record, name=job.folder.name), image.read_bytes())
            for damaged in (path for path in job.folder.glob("*.png") if not is_whole(path)):
                damaged.unlink()
        samples = first.artifact.settings.get("samples")
        left = [frame for frame in sorted(frames) if not all((j.folder / f"{frame}.png").is_file() for j in jobs)]
        many = min(len(left), _blenders(len(left) * len(paints), first.machine))
        parts = np.array_split(left, many)  # in their places' order: what stands around is built once for its frames
        wanted = RenderCamouflages(
            first.inputs[0], first.folder.parent, tuple(paints), None, samples, denoise=samples is None,
            scene=_scene(first.artifact), threads=0 if many == 1 else max(1, cores() // many),
            device=first.machine.render_device,
        )  # fmt: skip
        jobs_at_once = [replace(wanted, frames=tuple(map(str, part))) for part in parts]
        run_blenders(jobs_at_once, first.report, first.machine.blender)


def _blenders(images: int, machine: Machine) -> int:
    """How many Blenders render some images at once on the CPU.

    One alone leaves a third of two cores idle while it builds scenes, and more of more cores. Each takes a gigabyte and
    some seconds to start.
    """
    return 1 if machine.render_device != "cpu" else max(1, min(cores(), MOST_BLENDERS, images // IMAGES_A_BLENDER))


def make_composed(job: Job) -> None:
    """Compose pictures in a camouflage by their light maps: of photographs nothing can be rendered."""
    frames = job.artifact.options["frames"]
    render = Renderer(Dataset(job.inputs[0]), load_camouflage(job.inputs[1])[0].size)
    wear = wearer(render, job.inputs[1])
    for done, frame in enumerate(frame for frame in render.frames if frame.id in frames):
        job.report(Progress(done, len(frames), job.artifact.label))
        pixels = wear(frame)
        assert pixels is not None
        write_bytes(job.folder / f"{frame.id}.png", png_bytes(pixels))
    job.report(Progress(len(frames), len(frames), job.artifact.label))


def make_defended(job: Job) -> None:
    """Pass images through a defence; results are 8-bit sRGB, what a detector behind it is handed as a picture."""
    defence = make_defence(job.artifact.options["defence"])
    pictures = pictures_in(job.inputs[0], job.artifact.options["frames"])
    for done, (frame, path) in enumerate(zip(pictures.frames, pictures.paths, strict=True)):
        job.report(Progress(done, len(pictures.paths), job.artifact.label))
        target = job.folder / f"{frame.id}.png"
        if not is_whole(target):
            with torch.no_grad():
                (image,) = defence(image_tensor(path, frame)[None])
            write_bytes(target, png_bytes(to_pixels(image)))
    job.report(Progress(len(pictures.paths), len(pictures.paths), job.artifact.label))


def make_vacant(job: Job) -> None:
    """Grey out the columns of each picture that its vehicle, or the shadow beside it, reaches into."""
    pictures = pictures_in(job.inputs[0], job.artifact.options["frames"])
    for frame, path in zip(pictures.frames, pictures.paths, strict=True):
        if not is_whole(job.folder / f"{frame.id}.png"):
            pixels = without_vehicle(read_frame_image(path, frame), frame)
            write_bytes(job.folder / f"{frame.id}.png", png_bytes(pixels))


def has_detections(artifact: Artifact, folder: Path) -> bool:
    """Whether the detector has seen every wanted image, as it is now."""
    try:
        seen, images = detections_in(artifact, folder), source_of(folder)
        return all(file_digest(image_of(images, frame)) in seen for frame in artifact.options["frames"])
    except (RaucaError, OSError):
        return False


def detected_together(artifact: Artifact) -> object:
    """An image is decoded once for all detectors."""
    return artifact.inputs[0].digest, tuple(artifact.options["frames"]), str(artifact.settings["kept"])


def make_detections(*jobs: Job) -> None:
    """Detect in the images that a detector has not seen yet."""
    machine, first = jobs[0].machine, jobs[0].artifact
    seers = [
        (
            machine.detector(job.artifact.settings["fingerprint"], job.artifact.options["detector"]),
            detections_in(job.artifact, job.folder),
        )
        for job in jobs
    ]
    pictures, paint = pictures_in(jobs[0].inputs[0], first.options["frames"]), first.inputs[0].label

    def tell(done: int, total: int, detector: str) -> None:
        jobs[0].report(Progress(done, total, f"{detector} on {paint}" if detector else "detecting"))

    with threads(machine.threads):
        detect_in(pictures, seers, machine.device, tell)


def make_ranking(job: Job) -> None:
    """Show a detector some camouflages on training views, by the neural renderer."""
    settings, machine = job.artifact.settings, job.machine
    detector = machine.detector(settings["fingerprint"], job.artifact.options["detector"])
    data, *maps = job.inputs

    def tell(done: int, total: int) -> None:
        job.report(Progress(done, total, maps[done].stem))

    with threads(machine.threads):
        means = rank_camouflages(data, maps, detector, settings["category"], machine.device, tell)
    write_json(job.folder / RANKING, Ranking(tuple(means)).to_json())


def has_hardened(artifact: Artifact, folder: Path) -> bool:
    return any(folder.glob("hardened-*.json"))  # the card, which comes last


def make_hardened(job: Job) -> None:
    """Harden a detector, or go on where an earlier process stopped."""
    with threads(job.machine.threads):
        run_hardening(dict(job.artifact.options), job.folder, job.machine, job.report)


def make_interpolated(job: Job) -> None:
    """Choose how much of what a hardened detector learnt is kept."""
    with threads(job.machine.threads):
        run_interpolation(job)


def _scene(artifact: Artifact) -> Path | None:
    scene = artifact.options.get("scene")
    return Path(scene) if scene else None


def _link(source: str, target: str) -> None:
    Path(target).unlink(missing_ok=True)
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


@dataclass(frozen=True)
class Kind:
    """A kind of artifact.

    Attributes:
        what: it holds, for people.
        doing: what is said while it is made.
        make: of one job, or of all that are of one ``group``; goes on by itself where an earlier process stopped.
        complete: whether a folder holds all that is wanted of an artifact; or the file that is written last.
        heavy: worth a process, or a machine, of its own.
        group: artifacts of which it says the same are made together.
    """

    what: str
    doing: str
    make: Callable[..., None]
    complete: Callable[[Artifact, Path], bool] | str
    heavy: bool = True
    group: Callable[[Artifact], object] = lambda artifact: artifact.digest

    def has(self, artifact: Artifact, folder: Path) -> bool:
        """Whether the folder holds all that is wanted of an artifact."""
        return (folder / self.complete).is_file() if isinstance(self.complete, str) else self.complete(artifact, folder)


KINDS = {
    "vehicle": Kind(
        "vehicles from other formats", "reading the vehicle", make_vehicle, "vehicle.json", heavy=False
    ),
    "views": Kind("data sets", "rendering views", make_views, has_views),
    "part": Kind("parts of data sets, linked", "linking frames", make_part, "dataset.json", heavy=False),
    "extractor": Kind(
        "published extractors of light", "training the extractor", make_extractor, FINISHED
    ),
    "paint": Kind("optimized camouflages", "optimizing", make_paint, has_camouflage),
    "random": Kind(
        "random camouflages", "drawing random paint", make_random, has_camouflage, heavy=False
    ),
    "renders": Kind(
        "views in camouflage", "re-rendering in camouflage", make_renders, has_renders,
        group=rendered_together,
    ),
    "composed": Kind("pictures in camouflage, composed", "composing in camouflage", make_composed, has_renders),
    "defended": Kind("images after a defence", "defending", make_defended, has_renders),
    "vacant": Kind("views without their vehicle", "taking vehicles out", make_vacant, has_renders, heavy=False),
    "detections": Kind(
        "what detectors found", "detecting", make_detections, has_detections,
        group=detected_together,
    ),
    "ranking": Kind("camouflages by what hides best", "comparing camouflages", make_ranking, RANKING),
    "hardened": Kind("hardened detectors", "hardening", make_hardened, has_hardened),
    "interpolated": Kind(
        "hardened detectors, between as they were and as they learnt", "comparing other objects", make_interpolated,
        has_hardened,
    ),
}  # fmt: skip
