"""Detecting in many images with many detectors: each image is decoded once, for those that do not know it yet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..contract import Dataset, Frame, RaucaError
from ..contract.files import file_digest
from ..detect import Detector
from ..runtime.images import read_image
from .artifact import Artifact, read_recipe
from .detection_cache import DetectionCache, DetectionSettings

BATCH = 8  # images that are in memory at once
Seer = tuple[Detector, DetectionCache]
"""A detector, and what it has detected so far."""


@dataclass(frozen=True)
class Pictures:
    """The images of one paint: ``paths`` and sha256 ``hashes`` in the order of ``frames``."""

    frames: Sequence[Frame]
    paths: Sequence[Path]
    hashes: Sequence[str]

    @staticmethod
    def of(frames: Sequence[Frame], paths: Sequence[Path]) -> Pictures:
        return Pictures(frames, paths, [file_digest(path) for path in paths])


def pictures_in(folder: Path, ids: Sequence[str]) -> Pictures:
    """Frames of a data set with their images: the data set's own, or those of renders or defended images of it."""
    views = folder
    while not (views / "dataset.json").is_file():
        views = source_of(views)
    dataset = Dataset(views)
    dataset.require_rendered_or_pictured("detectors are judged on")
    known = {frame.id: frame for frame in dataset.frames()}
    return Pictures.of([known[frame] for frame in ids], [image_of(folder, frame) for frame in ids])


def image_of(folder: Path, frame: str) -> Path:
    """A frame's image in a data set, or in a folder of renders or defended images."""
    own = (folder / "dataset.json").is_file()
    return folder / "frames" / frame / "image.png" if own else folder / f"{frame}.png"


def source_of(folder: Path) -> Path:
    """The folder of an artifact's first input."""
    place = read_recipe(folder)[0].inputs[0].place
    assert place is not None
    return place


def detections_in(artifact: Artifact, folder: Path) -> DetectionCache:
    """What was detected in images so far."""
    settings = artifact.settings
    return DetectionCache(folder, settings["name"], settings["fingerprint"], DetectionSettings(**settings["kept"]))


def detect_in(
    pictures: Pictures,
    seers: Sequence[Seer],
    device: torch.device | str,
    report: Callable[[int, int, str], None] = lambda done, total, what: None,
) -> None:
    """Detect in every image that a detector has not seen.

    Args:
        device: where the detectors are.
        report: told how many of all pairs of image and detector are done, of how many, and the detector's name.
    """
    unknown = [_unknown(cache, pictures) for _, cache in seers]
    total = len(pictures.hashes) * len(seers)
    done = total - sum(map(len, unknown))
    report(done, total, "")
    wanted = sorted({index for some in unknown for index in some})
    for batch in (wanted[start : start + BATCH] for start in range(0, len(wanted), BATCH)):
        images = torch.stack([image_tensor(pictures.paths[i], pictures.frames[i]) for i in batch]).to(device)
        for detector, cache in seers:
            new = [place for place, index in enumerate(batch) if pictures.hashes[index] not in cache]
            if new:
                found = detector.detect(images[new], cache.settings.score_threshold, cache.settings.iou_threshold)
                cache.add(detector, [pictures.hashes[batch[place]] for place in new], found)
            done += len(new)
            report(done, total, detector.name)


def _unknown(cache: DetectionCache, pictures: Pictures) -> list[int]:
    """One index for each distinct image that the cache lacks."""
    first = {image: index for index, image in reversed(list(enumerate(pictures.hashes)))}
    return sorted(index for image, index in first.items() if image not in cache)


def image_tensor(path: Path, frame: Frame) -> Tensor:
    """(3, H, W) sRGB in [0, 1]; raises as :func:`read_frame_image`."""
    pixels = read_frame_image(path, frame)
    return torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1))).float() / 255


def read_frame_image(path: Path, frame: Frame) -> NDArray[np.uint8]:
    """(H, W, 3) sRGB, checked against the frame's camera; raises :class:`RaucaError` when the size differs."""
    pixels = read_image(path)
    expected = (frame.camera.height, frame.camera.width)
    if pixels.shape[:2] != expected:
        raise RaucaError(
            f"{path}: {pixels.shape[1]}x{pixels.shape[0]} pixels, frame {frame.id} has {expected[1]}x{expected[0]}; "
            "render it again at the data set's size"
        )
    return pixels if pixels.ndim == 3 else np.repeat(pixels[:, :, None], 3, axis=2)
