"""Where the image of a frame under some paint lies."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..contract import Dataset, Frame, RaucaError
from ..runtime.images import read_image

ImageOf = Callable[[Frame], Path]


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
