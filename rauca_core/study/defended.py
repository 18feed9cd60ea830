"""Images after a defence, kept on disk: it may cost more than a detector, and every detector needs its output."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from ..contract import Frame
from ..contract.files import png_bytes, write_bytes
from ..runtime.images import is_whole
from .defences import Defence
from .detecting import read_frame_image

NO_DEFENCE = "none"


def defended_images(
    defence: Defence,
    frames: Sequence[Frame],
    paths: Sequence[Path],
    targets: Sequence[Path],
    report: Callable[[int, int], None] = lambda done, total: None,
) -> None:
    """Defend the images of frames whose targets are not there yet, or damaged.

    Results are 8-bit sRGB: what a detector behind the defence would be handed as a picture.

    Args:
        paths, targets: of each frame's image, before and after.
        report: is told how many images are done, and of how many.

    Raises:
        RaucaError: an image that cannot be read or has another size than its frame.
    """
    for done, (frame, path, target) in enumerate(zip(frames, paths, targets, strict=True)):
        report(done, len(targets))
        if not is_whole(target):
            write_bytes(target, png_bytes(_defend(defence, read_frame_image(path, frame))))
    report(len(targets), len(targets))


def _defend(defence: Defence, pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    image = torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1))).float() / 255
    with torch.no_grad():
        (result,) = defence(image[None])
    rounded = (result.clamp(0, 1) * 255).round().to(torch.uint8)
    defended: NDArray[np.uint8] = np.ascontiguousarray(rounded.permute(1, 2, 0).cpu().numpy())
    return defended
