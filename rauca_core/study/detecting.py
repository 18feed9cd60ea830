"""Detecting in many images with many detectors: each image is decoded once, for those that do not know it yet."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..contract import Frame
from ..detect import Detector
from .detection_cache import DetectionCache
from .images_of import read_frame_image

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Pictures:
    """The images of one paint: ``paths`` and sha256 ``hashes`` in the order of ``frames``."""

    frames: Sequence[Frame]
    paths: Sequence[Path]
    hashes: Sequence[str]


def detect_everywhere(
    detectors: Sequence[Detector],
    caches: Mapping[str, DetectionCache],
    paints: Mapping[str, Pictures],
    batch_size: int,
    device: torch.device | str,
    on_progress: Progress,
) -> None:
    """Detect in every image that a detector's cache does not know.

    Args:
        caches: one per detector's name.
        device: where the detectors are.
        on_progress: called with what is being done, and how many of all pairs of image and detector are done.
    """
    total = sum(len(pictures.hashes) for pictures in paints.values()) * len(detectors)
    left = sum(len(_unknown(caches[d.name], p)) for d in detectors for p in paints.values())
    on_progress("detecting", total - left, total)
    for paint, pictures in paints.items():
        wanted = sorted({index for d in detectors for index in _unknown(caches[d.name], pictures)})
        for batch in (wanted[start : start + batch_size] for start in range(0, len(wanted), batch_size)):
            images = torch.stack([_tensor(pictures.paths[i], pictures.frames[i]) for i in batch]).to(device)
            for detector in detectors:
                left -= _detect(detector, caches[detector.name], images, [pictures.hashes[i] for i in batch])
                on_progress(f"{detector.name} on {paint}", total - left, total)


def _unknown(cache: DetectionCache, pictures: Pictures) -> list[int]:
    """One index for each distinct image that the cache lacks."""
    first = {image: index for index, image in reversed(list(enumerate(pictures.hashes)))}
    return sorted(index for image, index in first.items() if image not in cache)


def _detect(detector: Detector, cache: DetectionCache, images: Tensor, hashes: Sequence[str]) -> int:
    """Detect in the images of a batch that are new to this detector; returns how many those were."""
    new = [index for index, image in enumerate(hashes) if image not in cache]
    if new:
        settings = cache.settings
        found = detector.detect(images[new], settings.score_threshold, settings.iou_threshold)
        cache.add(detector, [hashes[index] for index in new], found)
    return len(new)


def _tensor(path: Path, frame: Frame) -> Tensor:
    pixels = read_frame_image(path, frame)
    return torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1))).float() / 255
