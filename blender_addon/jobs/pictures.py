"""Pictures in panels: small arrays and files as icons that layouts draw at any size. Nothing enters the user's file."""

from __future__ import annotations

from pathlib import Path

import bpy
import bpy.utils.previews
import numpy as np
from numpy.typing import NDArray

_shown: list[bpy.utils.previews.ImagePreviewCollection] = []  # one, from the first picture on


def _collection() -> bpy.utils.previews.ImagePreviewCollection:
    if not _shown:
        _shown.append(bpy.utils.previews.new())
    return _shown[0]


def show(name: str, pixels: NDArray[np.uint8] | NDArray[np.float32]) -> None:
    """Keep a picture under ``name``, in place of an earlier one.

    Args:
        pixels: (H, W, 3) sRGB bytes, or (H, W, 4) sRGB and alpha in [0, 1]; row 0 at the top.
    """
    fill(_collection().get(name) or _collection().new(name), pixels)


def fill(preview: bpy.types.ImagePreview, pixels: NDArray[np.uint8] | NDArray[np.float32]) -> None:
    """Give a preview a picture: (H, W, 3) sRGB, or (H, W, 4) with alpha; bytes, or floats in [0, 1]; row 0 on top."""
    height, width = pixels.shape[:2]
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., : pixels.shape[2]] = pixels / np.float32(255) if pixels.dtype == np.uint8 else pixels
    preview.image_size = (width, height)
    preview.image_pixels_float.foreach_set(np.ascontiguousarray(rgba[::-1]).ravel())


def load(name: str, path: Path, now: bool = False) -> int:
    """The icon of a picture's file, kept under ``name``.

    Args:
        now: read it at once, which is for small ones. Otherwise Blender reads it beside the window and draws a panel
            again, but not a menu, which would show no picture until the mouse moves.
    """
    if name not in _collection():
        loaded = _collection().load(name, str(path), "IMAGE")
        if now:
            _ = loaded.image_size[:]  # who asks for the size gets the picture read
    return icon(name)


def shown(name: str) -> bpy.types.ImagePreview | None:
    """The picture kept under ``name``."""
    return _shown[0].get(name) if _shown else None


def icon(name: str) -> int:
    """What ``layout.template_icon`` draws; 0 when there is no such picture, and without a window."""
    found = shown(name)
    return found.icon_id if found is not None else 0


def forget(prefix: str) -> None:
    """Drop the pictures whose names begin with ``prefix``."""
    for name in [name for name in _shown[0] if name.startswith(prefix)] if _shown else ():
        del _shown[0][name]


def close() -> None:
    """Drop everything."""
    while _shown:
        bpy.utils.previews.remove(_shown.pop())
