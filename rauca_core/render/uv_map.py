"""A camouflage's UV map, read at the size that a renderer looks it up in."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ..contract import RaucaError
from ..contract.color import linear_to_srgb, srgb_to_linear, to_bytes
from ..runtime.images import read_image


def read_uv_map(image: Path, size: int) -> NDArray[np.uint8]:
    """The PNG of a camouflage as (size, size, 3) sRGB; one of another size is resampled in linear light.

    Raises:
        RaucaError: as of :func:`read_image`; a picture that is no square, or without color.
    """
    pixels = read_image(image)
    if pixels.ndim != 3 or pixels.shape[0] != pixels.shape[1]:
        raise RaucaError(f"{image}: {pixels.shape[1]}x{pixels.shape[0]} pixels; a UV map is a square RGB picture")
    if len(pixels) == size:
        return pixels
    how = cv2.INTER_AREA if len(pixels) > size else cv2.INTER_LINEAR
    linear = cv2.resize(srgb_to_linear(pixels.astype(np.float32) / 255), (size, size), interpolation=how)
    return to_bytes(linear_to_srgb(np.asarray(linear, np.float32)))
