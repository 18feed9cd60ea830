"""Average precision of every detector on every paint: overall, and along each camera and weather parameter.

:func:`measure` is for images that were rendered by other means; a study makes its own, see `evaluate`.
"""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch

from ..contract import Dataset, Frame, RaucaError
from ..contract.files import file_digest
from ..detect import Detector, canonical, class_index, find_class, load_detector
from ..detect.weights import ready_names
from ..runtime.devices import find_device
from .average_precision import Sample
from .defences import Defence
from .defended import NO_DEFENCE, defended_images
from .detecting import ImageOf, Pictures, detect_everywhere, locate
from .detection_cache import DetectionCache, DetectionSettings
from .families import is_own
from .results import MEAN, FrameRow, ImageRow, Results, save_results
from .scores import Bootstrap, clusters_of, score_groups, score_table

ALL = "all"
LOG = logging.getLogger(__name__)
Chosen = tuple[str, Detector]
"""A detector, and what it was named by."""
Progress = Callable[[str, int, int], None]


def measure(
    dataset: Dataset,
    renders: Mapping[str, Path | ImageOf],
    detectors: Sequence[Detector],
    out: Path,
    on_progress: Progress = lambda what, done, total: None,
    settings: DetectionSettings | None = None,
    batch_size: int = 8,
    resamples: int = 1000,
    seed: int = 0,
    defence: Defence | None = None,
    only: Collection[str] | None = None,
    device: torch.device | str = "cpu",
) -> Results:
    """Measure paints on a data set and write ``out/results.json``.

    Detections are kept under ``out/detections``, defended images under ``out/images``: a second run only works on
    images that are new.

    Args:
        renders: paint name -> folder of ``<frame id>.png`` (8-bit sRGB, the frame's size), or a function from a frame
            to its image, such as :func:`reference_images` for the data set's own.
        on_progress: called with what is being done, how much of it is done, and how much there is.
        resamples, seed: of the bootstrap over locations behind the 95 % intervals.
        defence: applied to every image before detection.
        only: ids of the frames to evaluate on; all by default.
        device: where the detectors are.

    Raises:
        RaucaError: no frames with a visible vehicle, missing or wrongly sized images, a detector without the class.
    """
    settings = settings or DetectionSettings()
    check_detectors(detectors, settings.category)
    if not renders:
        raise RaucaError("evaluate: no paints given; name at least one folder of renders")
    every = [frame for frame in dataset.frames() if only is None or frame.id in only]
    frames = [frame for frame in every if frame.box_xyxy is not None]
    if not frames:
        raise RaucaError(f"{dataset.folder}: none of its {len(every)} frames shows the vehicle; nothing to evaluate")
    paints = _pictures(locate(renders, frames), frames, defence, out, on_progress)
    caches = {d.name: DetectionCache(out / "detections", d.name, d.fingerprint, settings) for d in detectors}
    detect_everywhere(detectors, caches, paints, batch_size, device, on_progress)
    name = NO_DEFENCE if defence is None else defence.name
    asked = Asked(settings, Bootstrap(resamples, seed), name, tuple(f.id for f in every if f.box_xyxy is None))
    return tabulate(dataset, paints, dict.fromkeys(paints, caches), out, asked)


@dataclass(frozen=True)
class Asked:
    """How detections become results.

    Attributes:
        settings: by which they were kept.
        defence: that the images went through.
        dropped: ids of frames without a box.
    """

    settings: DetectionSettings
    bootstrap: Bootstrap
    defence: str
    dropped: tuple[str, ...]


def tabulate(
    dataset: Dataset,
    paints: Mapping[str, Pictures],
    caches: Mapping[str, Mapping[str, DetectionCache]],
    out: Path,
    asked: Asked,
) -> Results:
    """Compute results from detections and write ``out/results.json``.

    Args:
        paints: the images of each, all of the same frames.
        caches: what was detected in them, by paint and detector.
    """
    frames = next(iter(paints.values())).frames
    samples = {
        paint: {name: _samples(cache, pictures) for name, cache in caches[paint].items()}
        for paint, pictures in paints.items()
    }
    rows, bootstrap = tuple(_frame_row(dataset, frame) for frame in frames), asked.bootstrap
    clusters = clusters_of(rows)
    results = Results(
        dataset=dataset.plan.name,
        settings=asked.settings,
        resamples=bootstrap.resamples,
        seed=bootstrap.seed,
        detectors={name: cache.fingerprint for name, cache in next(iter(caches.values())).items()},
        frames=rows,
        dropped=asked.dropped,
        table=score_table(samples, rows, bootstrap),
        groups=score_groups(samples, rows, bootstrap),
        images={paint: _image_rows(pictures, out) for paint, pictures in paints.items()},
        detections={
            paint: {name: _relative(cache.path.parent, out) for name, cache in caches[paint].items()}
            for paint in paints
        },
        vehicle=dataset.plan.vehicle_name,
        defence=asked.defence,
        clusters=clusters.kind,
        cluster_count=clusters.count,
    )
    save_results(out / "results.json", results)
    return results


def detectors_for(
    given: Sequence[Detector | str], categories: Sequence[str], device: str, published: bool = False
) -> dict[str, list[Chosen]]:
    """The detectors that each category of vehicle is shown to, each loaded once and with what it was named by.

    Args:
        given: loaded ones, or names and files, which must know every category; ``all``, or nothing, for every one that
            is ready, but for those that do not know a category.
        published: of the ready ones only those that were not trained on this project's images.

    Raises:
        RaucaError: none is ready, or a detector that was given does not know a category.
    """
    find_device(device)
    named = list(dict.fromkeys(one for one in given if one != ALL))
    ready = [name for name in ready_names() if name not in named] if ALL in given or not given else []
    ready = [name for name in ready if not (published and is_own(name))]
    if not named and not ready:
        raise RaucaError("--detectors: none is ready; get weights with `rauca weights fetch --all`")
    loaded: list[Chosen] = [
        (one, load_detector(one, device=device)) if isinstance(one, str) else (one.name, one.to(device))
        for one in [*named, *ready]
    ]
    result = {}
    for category in dict.fromkeys(categories):
        blind = {n for n, d in loaded if n in ready and find_class(d.class_names, category) is None}
        for name in sorted(blind):
            LOG.warning("%s: knows no class %r, left out there", name, category)
        result[category] = [(name, detector) for name, detector in loaded if name not in blind]
        check_detectors([detector for _, detector in result[category]], category)
    return result


def check_detectors(detectors: Sequence[Detector], category: str) -> None:
    """Raise :class:`RaucaError` unless there are detectors, each with a name of its own and the class ``category``."""
    names = [detector.name for detector in detectors]
    if not names:
        raise RaucaError("evaluate: no detectors given; name at least one")
    if len(set(names)) != len(names) or MEAN in names:
        raise RaucaError(f"evaluate: detectors {', '.join(names)} must have names of their own, none called {MEAN!r}")
    for detector in detectors:
        class_index(detector, category)


def _pictures(
    located: Mapping[str, Sequence[Path]],
    frames: Sequence[Frame],
    defence: Defence | None,
    out: Path,
    on_progress: Progress,
) -> dict[str, Pictures]:
    """The images that detectors will see, of every paint."""
    paints = {}
    for paint, paths in located.items():
        pictures = Pictures(frames, paths, [file_digest(path) for path in paths])
        if defence is not None and defence.name != NO_DEFENCE:
            report = partial(on_progress, f"{defence.name} on {paint}")
            targets = [out / "images" / f"{_key(defence, image_sha256)}.png" for image_sha256 in pictures.hashes]
            defended_images(defence, frames, paths, targets, report)
            paths = targets
            pictures = Pictures(frames, paths, [file_digest(path) for path in paths])
        paints[paint] = pictures
    return paints


def _samples(cache: DetectionCache, pictures: Pictures) -> list[Sample]:
    return [_sample(cache, frame, image) for frame, image in zip(pictures.frames, pictures.hashes, strict=True)]


def _sample(cache: DetectionCache, frame: Frame, image_sha256: str) -> Sample:
    found = cache[image_sha256].only(canonical(cache.settings.category))
    return Sample(np.array(frame.box_xyxy, np.float64), found.boxes, found.scores)


def _image_rows(pictures: Pictures, out: Path) -> tuple[ImageRow, ...]:
    return tuple(ImageRow(_relative(p, out), h) for p, h in zip(pictures.paths, pictures.hashes, strict=True))


def _frame_row(dataset: Dataset, frame: Frame) -> FrameRow:
    azimuth, elevation, distance = dataset.plan.ring.nominal(frame.view)
    assert frame.box_xyxy is not None
    return FrameRow(
        frame.id,
        frame.weather.name,
        azimuth,
        elevation,
        distance,
        frame.weather.sun_altitude_angle,
        frame.weather.fog_density,
        frame.box_xyxy,
        frame.location,
        frame.view,
    )


def _relative(path: Path, out: Path) -> str:
    return Path(os.path.relpath(path, out)).as_posix()


def _key(defence: Defence, image_sha256: str) -> str:
    """Names a defended image, so that neither image nor defence can change unnoticed."""
    return hashlib.sha256(f"{defence.fingerprint}\n{image_sha256}".encode()).hexdigest()[:24]
