"""Images by Blender's own reader, the only one in Blender's Python, and Blender's images as arrays and back."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import color, contract, reading


def read_image_blender(path: Path) -> NDArray[np.uint8]:
    """Read an 8-bit image, row 0 at the top: (H, W) for grey files, else (H, W, 3) sRGB; alpha is dropped.

    Raises:
        RaucaError: missing or damaged file, neither PNG nor JPEG, or too many pixels.
    """
    path = Path(path)
    if not path.is_file():
        raise contract.RaucaError(f"{path}: not found")
    header = image_header(path)
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


def image_header(path: Path) -> bytes:
    """The first bytes of a file, which declare an image's size; none where there is no file."""
    if not path.is_file():
        return b""
    with path.open("rb") as stream:
        return stream.read(reading.HEADER_BYTES)


def image_values(image: bpy.types.Image) -> NDArray[np.float32]:
    """The values of an image data block as they are stored, (H, W, channels), row 0 at the top."""
    width, height = image.size
    pixels = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(height, width, image.channels)[::-1]


def image_pixels(image: bpy.types.Image) -> NDArray[np.uint8]:
    """The stored 8-bit values of an image data block, as :func:`read_image_blender` returns them.

    The image may be the artist's: it is left as it is, for another color space would drop what was painted on it.
    """
    rgb = (image_values(image)[..., :3] * 255 + 0.5).astype(np.uint8)
    is_grey = image.depth in (8, 16) or image.channels == 1
    return np.ascontiguousarray(rgb[..., 0] if is_grey else rgb)


def image_linear(image: bpy.types.Image) -> NDArray[np.float32]:
    """The stored color of an image in linear light, (H, W, 3), row 0 at the top."""
    return np.ascontiguousarray(image_values(image)[..., :3])


def blender_pixels(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """(H, W, 3) values, row 0 at the top, as Blender keeps them: (H, W, 4), opaque, row 0 at the bottom."""
    pixels = np.ones((*linear.shape[:2], 4), np.float32)
    pixels[..., :3] = linear[::-1]
    return pixels


def float_image(name: str, pixels: NDArray[np.float32]) -> bpy.types.Image:
    """A new image of :func:`blender_pixels` in linear light, which Blender interpolates as they are."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=False, float_buffer=True, is_data=True)
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    return image


def srgb_image(name: str, srgb: NDArray[np.uint8]) -> bpy.types.Image:
    """A float image in linear light of 8-bit sRGB (H, W, 3), row 0 at the top."""
    return float_image(name, blender_pixels(color.srgb_to_linear(srgb / np.float32(255))))


def mask_image(mask: NDArray[np.uint8]) -> bpy.types.Image:
    """A vehicle's paint mask (H, W) as an image."""
    return float_image("rauca paint mask", blender_pixels(mask[..., None] / np.float32(255)))
