"""Reading images from disk, with limits and plain errors."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..contract import RaucaError
from ..contract.reading import MAX_PIXELS, require_file

FORMATS = ("PNG", "JPEG", "BMP", "TIFF", "WEBP")
"""Pillow knows some fifty; one of them (EPS) starts a program to read a file."""


def read_image(path: Path) -> NDArray[np.uint8]:
    """Read an image as 8 bits: (H, W) for grey files, else (H, W, 3) sRGB; alpha is dropped.

    Of 16 bits the upper 8 are read.

    Raises:
        RaucaError: missing, damaged or absurdly large file, a format other than :data:`FORMATS`, pixels of 32 bits.
    """
    path = Path(path)
    require_file(path)
    try:
        _verify(path)
        with _opened(path) as image:
            if image.mode.startswith("I;16"):  # which Pillow would clip; colors of 16 bits it cuts like this
                return (np.asarray(image) >> 8).astype(np.uint8)
            if image.mode in ("I", "F"):
                raise RaucaError(f"{path}: grey in Pillow's mode {image.mode}, of no known range; save it with 8 bits")
            return np.asarray(image.convert("L" if image.mode in ("1", "L") else "RGB"))
    except RaucaError:
        raise
    except Exception as error:  # Pillow's decoders raise whatever a damaged file makes of them
        raise RaucaError(f"{path}: not a readable image ({error or type(error).__name__})") from error


def is_whole(path: Path) -> bool:
    """Whether an image is there with the bytes that were written, as far as its format can tell: PNG can."""
    try:
        _verify(path)
    except Exception:
        return False
    return True


def _verify(path: Path) -> None:
    """Hold a PNG against its own checksums, which Pillow passes over when it decodes: a flipped bit shows otherwise."""
    with _opened(path) as image:
        image.verify()


def _opened(path: Path) -> Image.Image:
    """An image of which the header was read, and is no larger than :data:`MAX_PIXELS`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # Pillow's limit is higher, and only warns
        image = Image.open(path, formats=FORMATS)
    if image.width * image.height > MAX_PIXELS:
        image.close()
        raise RaucaError(f"{path}: {image.width}x{image.height} pixels; at most 8192x8192 are read")
    return image
