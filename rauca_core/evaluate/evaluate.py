"""Average precision of every detector on every paint: overall, and along each camera and weather parameter."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..contract import Dataset, Frame, RaucaError
from ..detect import Detector, class_index
from ..detect.weights_file import sha256_of
from .average_precision import Sample, average_precision
from .bootstrap import interval, resample_counts, resampled_average_precision
from .detection_cache import DetectionCache, DetectionSettings
from .images_of import ImageOf, locate, read_frame_image
from .results import AXES, MEAN, Estimate, FrameRow, Group, ImageRow, Results, save_results

Progress = Callable[[str, int, int], None]
Samples = dict[str, dict[str, list[Sample]]]


def evaluate(
    dataset: Dataset,
    renders: Mapping[str, Path | ImageOf],
    detectors: Sequence[Detector],
    out: Path,
    on_progress: Progress = lambda what, done, total: None,
    settings: DetectionSettings | None = None,
    batch_size: int = 8,
    resamples: int = 1000,
    seed: int = 0,
) -> Results:
    """Evaluate paints on a data set and write ``out/results.json``.

    Detections are kept under ``out/detections``: a second run only detects in images that are new.

    Args:
        renders: paint name -> folder of ``<frame id>.png`` (8-bit sRGB, the frame's size), or a function from a frame
            to its image, such as :func:`reference_images` for the data set's own.
        on_progress: called with what is being done, how many images are done, and how many there are.
        resamples, seed: of the bootstrap over frames behind the 95 % intervals.

    Raises:
        RaucaError: no frames with a visible vehicle, missing or wrongly sized images, a detector without the class.
    """
    settings = settings or DetectionSettings()
    _check_detectors(detectors, settings.category)
    if not renders:
        raise RaucaError("evaluate: no paints given; name at least one folder of renders")
    every = dataset.frames()
    frames = [frame for frame in every if frame.box_xyxy is not None]
    if not frames:
        raise RaucaError(f"{dataset.folder}: none of its {len(every)} frames shows the vehicle; nothing to evaluate")
    located = locate(renders, frames)
    images = {
        paint: tuple(ImageRow(_relative(path, out), sha256_of(path)) for path in paths)
        for paint, paths in located.items()
    }
    samples: Samples = {paint: {} for paint in located}
    for detector in detectors:
        cache = DetectionCache(out / "detections", detector.name, detector.fingerprint, settings)
        for paint, paths in located.items():
            hashes = [image.sha256 for image in images[paint]]
            report = partial(on_progress, f"{detector.name} on {paint}")
            _detect(detector, cache, frames, paths, hashes, batch_size, report)
            samples[paint][detector.name] = [_sample(cache, f, h) for f, h in zip(frames, hashes, strict=True)]
    rows = tuple(_frame_row(dataset, frame) for frame in frames)
    results = Results(
        dataset=dataset.plan.name,
        settings=settings,
        resamples=resamples,
        seed=seed,
        detectors={detector.name: detector.fingerprint for detector in detectors},
        frames=rows,
        dropped=tuple(frame.id for frame in every if frame.box_xyxy is None),
        table=_table(samples, resample_counts(len(frames), resamples, seed)),
        groups={axis: _groups(samples, rows, axis) for axis in AXES},
        images=images,
    )
    save_results(out / "results.json", results)
    return results


def _check_detectors(detectors: Sequence[Detector], category: str) -> None:
    names = [detector.name for detector in detectors]
    if not names:
        raise RaucaError("evaluate: no detectors given; name at least one")
    if len(set(names)) != len(names) or MEAN in names:
        raise RaucaError(f"evaluate: detectors {', '.join(names)} must have names of their own, none called {MEAN!r}")
    for detector in detectors:
        class_index(detector, category)


def _detect(
    detector: Detector,
    cache: DetectionCache,
    frames: Sequence[Frame],
    paths: Sequence[Path],
    hashes: Sequence[str],
    batch_size: int,
    report: Callable[[int, int], None],
) -> None:
    """Detect in the images that the cache does not know yet."""
    new = {h: index for index, h in enumerate(hashes) if h not in cache}
    known = len(hashes) - len(new)
    report(known, len(hashes))
    for done, batch in _batches(list(new.values()), batch_size):
        images = torch.stack([_tensor(paths[index], frames[index]) for index in batch])
        found = detector.detect(images, cache.settings.score_threshold, cache.settings.iou_threshold)
        for index, detections in zip(batch, found, strict=True):
            cache.add(detector, hashes[index], detections)
        report(known + done, len(hashes))


def _batches(indices: list[int], size: int) -> Iterator[tuple[int, list[int]]]:
    for start in range(0, len(indices), size):
        batch = indices[start : start + size]
        yield start + len(batch), batch


def _tensor(path: Path, frame: Frame) -> Tensor:
    pixels = read_frame_image(path, frame)
    return torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1))).float() / 255


def _sample(cache: DetectionCache, frame: Frame, image_sha256: str) -> Sample:
    found = cache[image_sha256].only(cache.settings.category)
    return Sample(np.array(frame.box_xyxy, np.float64), found.boxes, found.scores)


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
    )


def _table(samples: Samples, counts: np.ndarray) -> dict[str, dict[str, Estimate]]:
    """AP of every paint and detector, and the mean over detectors, each with its interval."""
    table = {}
    for paint, by_detector in samples.items():
        values = {name: average_precision(some) for name, some in by_detector.items()}
        resampled = {name: resampled_average_precision(some, counts) for name, some in by_detector.items()}
        values[MEAN] = float(np.mean(list(values.values())))
        resampled[MEAN] = np.mean(list(resampled.values()), axis=0)
        table[paint] = {name: Estimate(value, *interval(resampled[name])) for name, value in values.items()}
    return table


def _groups(samples: Samples, rows: Sequence[FrameRow], axis: str) -> tuple[Group, ...]:
    """AP over the frames that share a value of ``axis``."""
    values = [float(getattr(row, axis)) for row in rows]
    groups = []
    for value in sorted(set(values)):
        chosen = [index for index, found in enumerate(values) if found == value]
        ap = {
            paint: {name: average_precision([some[i] for i in chosen]) for name, some in by_detector.items()}
            for paint, by_detector in samples.items()
        }
        groups.append(Group(value, len(chosen), ap))
    return tuple(groups)


def _relative(path: Path, out: Path) -> str:
    return Path(os.path.relpath(path, out)).as_posix()
