"""Pictures in panels: small arrays as icons that layouts can draw at any size. Nothing enters the user's file."""

from __future__ import annotations

import bpy
import bpy.utils.previews
import numpy as np
from numpy.typing import NDArray

_shown: bpy.utils.previews.ImagePreviewCollection | None = None


def show(name: str, pixels: NDArray[np.uint8] | NDArray[np.float32]) -> None:
    """Keep a picture under ``name``, in place of an earlier one.

    Args:
        pixels: (H, W, 3) sRGB bytes, or (H, W, 4) sRGB and alpha in [0, 1]; row 0 at the top.
    """
    global _shown
    if _shown is None:
        _shown = bpy.utils.previews.new()
    preview = _shown.get(name) or _shown.new(name)
    height, width = pixels.shape[:2]
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., : pixels.shape[2]] = pixels / np.float32(255) if pixels.dtype == np.uint8 else pixels
    preview.image_size = (width, height)
    preview.image_pixels_float.foreach_set(np.ascontiguousarray(rgba[::-1]).ravel())


def shown(name: str) -> bpy.types.ImagePreview | None:
    """The picture kept under ``name``."""
    return _shown.get(name) if _shown is not None else None


def icon(name: str) -> int:
    """What ``layout.template_icon`` draws; 0 when there is no such picture, and without a window."""
    found = shown(name)
    return found.icon_id if found is not None else 0


def forget(prefix: str) -> None:
    """Drop the pictures whose names begin with ``prefix``."""
    if _shown is not None:
        for name in [name for name in _shown if name.startswith(prefix)]:
            del _shown[name]


def close() -> None:
    """Drop everything."""
    global _shown
    if _shown is not None:
        bpy.utils.previews.remove(_shown)
        _shown = None
