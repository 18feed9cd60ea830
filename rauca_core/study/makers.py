"""The makers of artifacts, one for each of `kinds`, and how each knows that its work is done."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..attack import StepReport, make_settings, random_camouflage, run_optimization
from ..contract import (
    Dataset,
    Frame,
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
from ..contract.files import file_digest
from ..contract.schema import Fields
from ..runtime.blender import run_blender
from ..runtime.checkpoint_files import started
from ..runtime.cpu import threads
from ..runtime.images import is_whole, read_image
from ..training.extractor_fit import FINISHED, PUBLISHED_WEIGHTS, fit_published
from .agreement import FILE_NAME as AGREEMENT
from .agreement import measure_agreement, save_agreement
from .artifact import Artifact, read_recipe
from .defences import make_defence
from .defended import defended_images
from .detecting import Pictures, detect_everywhere
from .detection_cache import DetectionCache, DetectionSettings
from .harden_rounds import run_hardening
from .job import Job

CAMOUFLAGE = "camouflage.json"


def has_vehicle(artifact: Artifact, folder: Path) -> bool:
    return (folder / "vehicle.json").is_file()


def make_vehicle(job: Job) -> None:
    """Read a vehicle from another format, in Blender."""
    given = Fields(job.artifact.options["source"], job.artifact.name)
    run_blender(ImportVehicle(job.folder, VehicleSource.from_json(given)), job.report, job.machine.blender)


def has_plan(artifact: Artifact, folder: Path) -> bool:
    return (folder / "dataset.json").is_file()


def has_views(artifact: Artifact, folder: Path) -> bool:
    """Whether none of the wanted frames is left to be rendered."""
    if not has_plan(artifact, folder):
        return False
    states = frame_states(folder)
    return all(states.get(frame) in ("done", "occluded") for frame in artifact.options["frames"])


def make_views(job: Job) -> None:
    """Render the frames of a data set that are missing, in Blender; a finished one is never rendered again."""
    wanted = job.artifact
    fields = {**wanted.settings["plan"], "name": wanted.label, "blender": ""}
    plan = Plan.from_json(Fields(fields, wanted.name))
    vehicle, frames = VehicleSource(str(job.inputs[0])), tuple(wanted.options["frames"])
    device = job.machine.render_device
    asked = MakeDataset(job.folder, plan, vehicle, _scene(wanted), frames, device=device)
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


def has_extractor(artifact: Artifact, folder: Path) -> bool:
    return (folder / FINISHED).is_file()


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
    views = ""

    def show(step: StepReport) -> None:
        job.report(Progress(step.step, step.steps, f"loss {step.loss:.3f}  score {step.score:.2f}{views}"))

    def show_views(done: int, total: int) -> None:
        nonlocal views
        views = f"  views {done}/{total}" if done < total else ""

    data, folder = Dataset(job.inputs[0]), job.folder
    run_optimization(data, detectors, settings, folder, show, started(folder), show_views, job.machine.processes)


def make_random(job: Job) -> None:
    """Random paint, the baseline of all others."""
    random_camouflage(job.folder / CAMOUFLAGE, load_vehicle(job.inputs[0], read_image), **job.artifact.settings)


def has_renders(artifact: Artifact, folder: Path) -> bool:
    """Whether the images of all wanted frames are there, and none is damaged."""
    return all(is_whole(folder / f"{frame}.png") for frame in artifact.options["frames"])


def rendered_together(artifact: Artifact) -> object:
    """One Blender renders the same frames in several camouflages."""
    return artifact.inputs[0].digest, tuple(artifact.options["frames"]), str(artifact.settings)


def make_renders(jobs: Sequence[Job]) -> None:
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
        wanted = RenderCamouflages(
            first.inputs[0], first.folder.parent, tuple(paints), tuple(frames), samples, denoise=samples is None,
            scene=_scene(first.artifact), device=first.machine.render_device,
        )  # fmt: skip
        run_blender(wanted, first.report, first.machine.blender)


def make_defended(job: Job) -> None:
    """Pass images through a defence."""
    defence = make_defence(job.artifact.options["defence"])
    pictures = pictures_in(job.inputs[0], job.artifact.options["frames"])
    targets = [job.folder / f"{frame.id}.png" for frame in pictures.frames]

    def tell(done: int, total: int) -> None:
        job.report(Progress(done, total, job.artifact.label))

    defended_images(defence, pictures.frames, pictures.paths, targets, tell)


def has_detections(artifact: Artifact, folder: Path) -> bool:
    """Whether the detector has seen every wanted image, as it is now."""
    try:
        seen = detections_in(artifact, folder)
        return all(image in seen for image in _images_behind(folder, artifact.options["frames"]).hashes)
    except (RaucaError, OSError):
        return False


def detections_in(artifact: Artifact, folder: Path) -> DetectionCache:
    """What was detected in images so far."""
    settings = artifact.settings
    return DetectionCache(folder, settings["name"], settings["fingerprint"], DetectionSettings(**settings["kept"]))


def detected_together(artifact: Artifact) -> object:
    """An image is decoded once for all detectors."""
    return artifact.inputs[0].digest, tuple(artifact.options["frames"]), str(artifact.settings["kept"])


def make_detections(jobs: Sequence[Job]) -> None:
    """Detect in the images that a detector has not seen yet."""
    machine, first = jobs[0].machine, jobs[0].artifact
    detectors = [
        machine.detector(job.artifact.settings["fingerprint"], job.artifact.options["detector"]) for job in jobs
    ]
    caches = {job.artifact.settings["name"]: detections_in(job.artifact, job.folder) for job in jobs}
    pictures = pictures_in(jobs[0].inputs[0], first.options["frames"])

    def tell(what: str, done: int, total: int) -> None:
        jobs[0].report(Progress(done, total, what))

    paint = first.inputs[0].label
    with threads(machine.threads):
        detect_everywhere(detectors, caches, {paint: pictures}, first.options["batch"], machine.device, tell)


def pictures_in(folder: Path, ids: Sequence[str]) -> Pictures:
    """Frames of a data set with their images: the data set's own, or those of renders or defended images of it."""
    views = views_behind(folder)
    known = {frame.id: frame for frame in Dataset(views).frames()}
    frames: list[Frame] = [known[frame] for frame in ids]
    paths = [image_of(folder, frame.id) for frame in frames]
    return Pictures(frames, paths, [file_digest(path) for path in paths])


def image_of(folder: Path, frame: str) -> Path:
    """A frame's image in a data set, or in a folder of renders or defended images."""
    if (folder / "dataset.json").is_file():
        return folder / "frames" / frame / "image.png"
    return folder / f"{frame}.png"


def views_behind(folder: Path) -> Path:
    """The data set that renders, or defended images, are of."""
    while not (folder / "dataset.json").is_file():
        place = read_recipe(folder)[0].inputs[0].place
        assert place is not None
        folder = place
    return folder


def has_agreement(artifact: Artifact, folder: Path) -> bool:
    return (folder / AGREEMENT).is_file()


def make_agreement(job: Job) -> None:
    """Compare the neural renderer with Cycles: by coverage on all frames, by color on those that were rendered."""
    dataset, camouflage, rendered = job.inputs
    job.report(Progress(0, 1, job.artifact.label))
    save_agreement(job.folder / AGREEMENT, measure_agreement(Dataset(dataset), camouflage, rendered))


def has_hardened(artifact: Artifact, folder: Path) -> bool:
    return any(path.with_suffix(".json").is_file() for path in folder.glob("hardened-*.safetensors"))


def make_hardened(job: Job) -> None:
    """Harden a detector, or go on where an earlier process stopped."""
    with threads(job.machine.threads):
        run_hardening(dict(job.artifact.options), job.folder, job.machine, job.report)


def _images_behind(folder: Path, ids: Sequence[str]) -> Pictures:
    place = read_recipe(folder)[0].inputs[0].place
    assert place is not None
    paths = [image_of(place, frame) for frame in ids]
    return Pictures((), paths, [file_digest(path) for path in paths])


def _scene(artifact: Artifact) -> Path | None:
    scene = artifact.options.get("scene")
    return Path(scene) if scene else None


def _link(source: str, target: str) -> None:
    Path(target).unlink(missing_ok=True)
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)
