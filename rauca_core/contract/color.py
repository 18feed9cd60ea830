"""The sRGB transfer function, the only display transform of this project (Blender's `Standard`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def linear_to_srgb(linear: NDArray[np.floating]) -> NDArray[np.float32]:
    """Encode linear light as sRGB values in [0, 1] (IEC 61966-2-1); light beyond [0, 1] is clipped."""
    x = np.clip(np.nan_to_num(linear), 0.0, 1.0).astype(np.float32)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.power(x, 1 / 2.4) - 0.055).astype(np.float32)


def srgb_to_linear(srgb: NDArray[np.floating]) -> NDArray[np.float32]:
    """Decode sRGB values in [0, 1] to linear light; values beyond [0, 1] are clipped."""
    x = np.clip(srgb, 0.0, 1.0).astype(np.float32)
    return np.where(x <= 0.04045, x / 12.92, np.power((x + 0.055) / 1.055, 2.4)).astype(np.float32)


def to_bytes(unit: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Quantize values in [0, 1] to 8 bits, rounding to nearest."""
    return (np.clip(unit, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
