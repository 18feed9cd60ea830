"""Reading images from disk, with limits and plain errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from .contract import RaucaError

MAX_PIXELS = 16384 * 16384


def read_image(path: Path) -> NDArray[np.uint8]:
    """Read an 8-bit image: (H, W) for grey files, else (H, W, 3) sRGB; alpha is dropped.

    Raises:
        RaucaError: missing, damaged or absurdly large file.
    """
    try:
        _verify(path)
        with Image.open(path) as image:
            if image.width * image.height > MAX_PIXELS:
                raise RaucaError(f"{path}: {image.width}x{image.height} pixels; at most 16384x16384 are read")
            return np.asarray(image.convert("L" if image.mode in ("1", "L", "I;16") else "RGB"))
    except FileNotFoundError:
        raise RaucaError(f"{path}: not found") from None
    except (UnidentifiedImageError, Image.DecompressionBombError, OSError, SyntaxError, ValueError) as error:
        raise RaucaError(f"{path}: not a readable image ({error})") from error


def is_whole(path: Path) -> bool:
    """Whether an image is there with the bytes that were written, as far as its format can tell: PNG can."""
    try:
        _verify(path)
    except Exception:
        return False
    return True


def _verify(path: Path) -> None:
    """Hold a PNG against its own checksums, which Pillow passes over when it decodes: a flipped bit shows otherwise."""
    with Image.open(path) as image:
        image.verify()
