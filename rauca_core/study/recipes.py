"""The artifacts of studies: what each is called and depends on. `makers` makes them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..attack import OptimizerSettings
from ..contract import (
    Dataset,
    Plan,
    RaucaError,
    Vehicle,
    VehicleSource,
    frame_folder,
    load_camouflage,
    load_vehicle,
    read_plan,
)
from ..contract.files import file_digest, read_sums
from ..detect import Detector
from ..runtime.images import read_image
from .artifact import Artifact, digest_of
from .defences import Defence
from .detection_cache import DetectionSettings


def vehicle_in(folder: Path) -> Artifact:
    """The vehicle of a folder, by all that a render shows of it."""
    vehicle = load_vehicle(folder, read_image)
    return Artifact("vehicle", vehicle.name, {"content": _content(vehicle)}, place=Path(folder))


def vehicle_file(path: Path, paint_mask: Path | None = None, paint_material: str | None = None) -> Artifact:
    """A vehicle that Blender has to read first: an .obj, .glb or .blend, and where its paint is."""
    if not path.is_file():
        raise RaucaError(f"{path}: no such vehicle; give a shipped one's name, its folder, an .obj, a .glb or a .blend")
    mask = None if paint_mask is None else file_digest(paint_mask)
    source = VehicleSource(str(path), paint_mask, paint_material)
    settings = {"file": file_digest(path), "paint_mask": mask, "paint_material": paint_material}
    return Artifact("vehicle", path.stem, settings, options={"source": source.to_json()})


def data_set(
    label: str, plan: Plan, vehicle: Artifact, frames: Sequence[str], scene: Path | None = None, exact: bool = False
) -> Artifact:
    """A data set to be rendered.

    Args:
        vehicle: finished.
        frames: ids of those that are wanted.
        scene: the .blend that it stands in, if that is not the town.
        exact: it is to hold no other frames than these, as what is trained on it depends on them; else it may grow.
    """
    settings = _plan_settings(plan) | ({"frames": digest_of(sorted(frames))} if exact else {})
    options = {"frames": list(frames), "scene": None if scene is None else str(scene.absolute())}
    return Artifact("views", label, settings, (vehicle,), options)


def views_in(folder: Path, scene: Path | None = None) -> Artifact:
    """The data set in a folder, wherever it was made; the same recipe as that of :func:`data_set` where it may grow."""
    label = Path(folder).absolute().name
    options: dict[str, Any] = {"frames": [], "scene": None if scene is None else str(scene.absolute())}
    vehicle = vehicle_in(Path(folder) / "vehicle")
    return Artifact("views", label, _plan_settings(read_plan(folder)), (vehicle,), options, Path(folder))


def part_of(whole: Artifact, label: str, frames: Sequence[str]) -> Artifact:
    """Some frames of a data set as a data set of their own."""
    return Artifact("part", label, {"frames": list(frames)}, (whole,))


def extractor(training: Artifact, epochs: int) -> Artifact:
    """The published extractor of light, trained on a data set."""
    return Artifact("extractor", training.label, {"epochs": epochs}, (training,))


def paint(
    training: Artifact,
    settings: OptimizerSettings,
    attacked: Sequence[tuple[str, Detector]],
    extractor: Artifact | None = None,
) -> Artifact:
    """A camouflage to be optimized on a data set against detectors.

    Args:
        settings: ``name`` is the label.
        attacked: detectors, each with what it was named by, for another process.
    """
    depends: dict[str, Any] = {
        "optimizer": {k: v for k, v in settings.identity().items() if k not in ("steps", "extractor")},
        "steps": settings.steps,
        "detectors": [detector.fingerprint for _, detector in attacked],
    }
    if training.place is not None:  # nobody knows which frames it holds but itself
        depends["frames"] = digest_of([frame.id for frame in Dataset(training.place).frames()])
    names = [typed for typed, _ in attacked]
    options = {"settings": settings.model_dump(mode="json", exclude={"threads"}), "detectors": names}
    inputs = (training,) if extractor is None else (training, extractor)
    return Artifact("paint", settings.name, depends, inputs, options)


def random_paint(vehicle: Artifact, size: int, seed: int, cell: int) -> Artifact:
    """Random paint; ``size`` and ``cell`` in texels."""
    return Artifact("random", "random", {"size": size, "seed": seed, "cell": cell}, (vehicle,))


def camouflage_in(path: Path, label: str) -> Artifact:
    """A finished camouflage, known by its UV map: whoever made it, renders of it are the same."""
    record, image = load_camouflage(path)
    settings = {"uv_map": file_digest(image), "atlas_id": record.atlas_id, "size": record.size}
    return Artifact("map", label, settings, place=path.absolute())


def renders(views: Artifact, camouflage: Artifact, frames: Sequence[str], samples: int | None = None) -> Artifact:
    """Views rendered in a camouflage.

    Args:
        frames: ids of finished frames of the views.
        samples: render whole frames with so many samples and no denoiser, as a reference; as the views if None.
    """
    settings = {} if samples is None else {"samples": samples}
    options = {"frames": list(frames), "scene": views.options.get("scene")}
    return Artifact("renders", camouflage.label, settings, (views, camouflage), options)


def composed(pictures: Artifact, camouflage: Artifact, frames: Sequence[str]) -> Artifact:
    """Pictures from elsewhere in a camouflage, composed by their light maps.

    Args:
        pictures: a data set of them, in its folder; its plan does not tell it from others, so its files do.
        frames: ids of those that are wanted.
    """
    assert pictures.place is not None
    files = {frame: read_sums(frame_folder(pictures.place, frame)) for frame in frames}
    settings = {"files": digest_of(files)}
    return Artifact("composed", camouflage.label, settings, (pictures, camouflage), {"frames": list(frames)})


def ranking(
    training: Artifact, camouflages: Sequence[Artifact], detector: Detector, typed: str, category: str
) -> Artifact:
    """How well finished camouflages hide the vehicle of a data set from a detector."""
    settings = {"fingerprint": detector.fingerprint, "category": category}
    return Artifact("ranking", detector.name, settings, (training, *camouflages), {"detector": typed})


def defended(images: Artifact, defence: Defence, frames: Sequence[str]) -> Artifact:
    """Images of views or renders after a defence."""
    options = {"defence": defence.name, "frames": list(frames)}
    label = f"{images.label}-{defence.name}"
    return Artifact("defended", label, {"defence": defence.fingerprint}, (images,), options)


def vacant(views: Artifact, frames: Sequence[str]) -> Artifact:
    """Pictures of views without their vehicle: the part of each that it does not stand in."""
    return Artifact("vacant", "vacant", {}, (views,), {"frames": list(frames)})


def detections(
    images: Artifact, detector: Detector, typed: str, kept: DetectionSettings, frames: Sequence[str]
) -> Artifact:
    """What a detector finds in images of views, renders or defended images."""
    settings = {"name": detector.name, "fingerprint": detector.fingerprint, "kept": dict(kept.__dict__)}
    options = {"detector": typed, "frames": list(frames)}
    return Artifact("detections", f"{detector.name}-{images.label}", settings, (images,), options)


def hardened(
    detector: str, datasets: Sequence[Path], identity: Mapping[str, Any], options: Mapping[str, Any]
) -> Artifact:
    """A detector hardened on data sets; ``identity`` is what its training depends on."""
    label = Path(detector).stem
    return Artifact("hardened", label, dict(identity), tuple(map(views_in, datasets)), options)


def interpolated(detector: str, hardened: Artifact, views: Artifact, agreement: float) -> Artifact:
    """What is kept of a hardened detector, as views to be rendered decide it."""
    frames = list(views.options["frames"])
    settings = {"agreement": agreement, "frames": digest_of(sorted(frames))}
    return Artifact(
        "interpolated", hardened.label, settings, (hardened, views), {"detector": detector, "frames": frames}
    )


def _plan_settings(plan: Plan) -> dict[str, Any]:
    """What a plan says of its frames' bytes: neither its name nor Blender's version, which may change meanwhile."""
    fields = replace(plan, name="", blender="").to_json()
    return {"plan": {name: value for name, value in fields.items() if name not in ("name", "blender")}}


def _content(vehicle: Vehicle) -> str:
    """Names what renders show of a vehicle."""
    digest = hashlib.sha256(f"{vehicle.geometry_id} {vehicle.category}".encode())
    digest.update(digest_of([material.to_json() for material in vehicle.materials]).encode())
    digest.update(np.ascontiguousarray(vehicle.material).tobytes())
    if vehicle.base_texture is not None:
        digest.update(str(vehicle.base_texture.shape).encode() + np.ascontiguousarray(vehicle.base_texture).tobytes())
    return digest.hexdigest()[:16]
