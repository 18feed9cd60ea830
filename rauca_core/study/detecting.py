"""Detecting in many images with many detectors: each image is decoded once, for those that do not know it yet.

Where the image of a frame under some paint lies is told by a folder, or by a function of the frame.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..contract import Dataset, Frame, RaucaError
from ..detect import Detector
from ..runtime.images import read_image
from .detection_cache import DetectionCache

ImageOf = Callable[[Frame], Path]
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


def reference_images(dataset: Dataset) -> ImageOf:
    """The data set's own images: the vehicle in its reference paint."""
    return lambda frame: dataset.frame_folder(frame.id) / "image.png"


def rendered_in(folder: Path) -> ImageOf:
    """Images rendered into one folder, ``<frame id>.png``."""
    return lambda frame: Path(folder) / f"{frame.id}.png"


def locate(renders: Mapping[str, Path | ImageOf], frames: list[Frame]) -> dict[str, list[Path]]:
    """The images of every paint in the order of ``frames``; raises :class:`RaucaError` when some are missing."""
    located = {}
    for paint, source in renders.items():
        image_of = rendered_in(source) if isinstance(source, Path) else source
        paths = [image_of(frame) for frame in frames]
        missing = [path for path in paths if not path.is_file()]
        if missing:
            raise RaucaError(
                f"{missing[0]}: not found; {len(missing)} of {len(paths)} images of paint {paint!r} are missing, "
                "render them first"
            )
        located[paint] = paths
    return located


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
