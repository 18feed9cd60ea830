"""Reading images with Blender's own reader, the only one in Blender's Python."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import contract, reading


def read_image_blender(path: Path) -> NDArray[np.uint8]:
    """Read an 8-bit image, row 0 at the top: (H, W) for grey files, else (H, W, 3) sRGB; alpha is dropped.

    Raises:
        RaucaError: missing or damaged file, neither PNG nor JPEG, or too many pixels.
    """
    path = Path(path)
    if not path.is_file():
        raise contract.RaucaError(f"{path}: not found")
    with path.open("rb") as stream:
        header = stream.read(reading.HEADER_BYTES)
    if reading.declared_size(header) is None:
        raise contract.RaucaError(f"{path}: not a readable image; save it as PNG or JPEG")
    reading.require_size(header, str(path))
    try:
        image = bpy.data.images.load(str(path.resolve()), check_existing=False)
    except RuntimeError as error:
        raise contract.RaucaError(f"{path}: not a readable image ({str(error).strip()})") from error
    try:
        if not image.size[0] or not image.size[1]:
            raise contract.RaucaError(f"{path}: not a readable image")
        image.colorspace_settings.name = "Non-Color"  # files of 16 bits too as they are stored, not as light
        return image_pixels(image)
    finally:
        bpy.data.images.remove(image)


def image_pixels(image: bpy.types.Image) -> NDArray[np.uint8]:
    """The stored 8-bit values of an image data block, as :func:`read_image_blender` returns them.

    The image may be the artist's: it is left as it is, for another color space would drop what was painted on it.
    """
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    rgb = (pixels.reshape(height, width, 4)[::-1, :, :3] * 255 + 0.5).astype(np.uint8)
    is_grey = image.depth in (8, 16) or image.channels == 1
    return np.ascontiguousarray(rgb[..., 0] if is_grey else rgb)


def image_linear(image: bpy.types.Image) -> NDArray[np.float32]:
    """The values of an image data block as they are stored, (H, W, 3), row 0 at the top: for images in linear light."""
    width, height = image.size
    pixels = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    return np.ascontiguousarray(pixels.reshape(height, width, image.channels)[::-1, :, :3])
