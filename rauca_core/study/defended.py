"""Images after a defence, kept on disk: it may cost more than a detector, and every detector needs its output."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from ..contract import Frame
from ..contract.files import png_bytes, write_bytes
from ..runtime.images import is_whole
from .defences import Defence
from .images_of import read_frame_image

NO_DEFENCE = "none"


def defended_images(
    defence: Defence,
    frames: Sequence[Frame],
    paths: Sequence[Path],
    hashes: Sequence[str],
    folder: Path,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> list[Path]:
    """Defend the images of frames that were not defended before, or whose result is damaged; returns the paths of all.

    A result is named by the defence's fingerprint and the image's hash, so that neither can change unnoticed. It is
    8-bit sRGB: what a detector behind the defence would be handed as a picture.

    Args:
        paths, hashes: of each frame's image, and the image files' sha256.
        report: is told how many images are done, and of how many.

    Raises:
        RaucaError: an image that cannot be read or has another size than its frame.
    """
    results = [folder / f"{_key(defence, image_sha256)}.png" for image_sha256 in hashes]
    for done, (frame, path, result) in enumerate(zip(frames, paths, results, strict=True)):
        report(done, len(results))
        if not is_whole(result):
            write_bytes(result, png_bytes(_defend(defence, read_frame_image(path, frame))))
    report(len(results), len(results))
    return results


def _defend(defence: Defence, pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    image = torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1))).float() / 255
    with torch.no_grad():
        (result,) = defence(image[None])
    rounded = (result.clamp(0, 1) * 255).round().to(torch.uint8)
    defended: NDArray[np.uint8] = np.ascontiguousarray(rounded.permute(1, 2, 0).cpu().numpy())
    return defended


def _key(defence: Defence, image_sha256: str) -> str:
    return hashlib.sha256(f"{defence.fingerprint}\n{image_sha256}".encode()).hexdigest()[:24]
