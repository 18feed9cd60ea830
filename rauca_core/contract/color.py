"""The sRGB transfer function, the only display transform of this project (Blender's `Standard`); recolored frames.

The sets of colors are the paper's: the eight corners of the RGB cube and mid grey to train an environment feature
extractor on, 32 others to test it on. The paper does not name its 32; ours are the first 32 points of the Halton
sequence (bases 2, 3, 5) in the sRGB cube that keep at least 48 of 255 away from every training color in some channel.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from .errors import RaucaError
from .seeding import named_rng


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


Color = tuple[int, int, int]

TRAIN: tuple[Color, ...] = (
    (0, 0, 0), (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0), (255, 0, 255), (0, 255, 255), (255, 255, 255),
    (128, 128, 128),
)  # fmt: skip
"""8-bit sRGB: the corners of the cube, and mid grey."""

TEST: tuple[Color, ...] = (
    (128, 85, 51), (64, 170, 102), (191, 28, 153), (32, 113, 204), (159, 198, 10), (96, 57, 61), (223, 142, 112),
    (16, 227, 163), (143, 9, 214), (80, 94, 20), (207, 179, 71), (48, 38, 122), (112, 208, 224), (239, 66, 31),
    (8, 151, 82), (135, 236, 133), (72, 19, 184), (199, 104, 235), (40, 189, 41), (167, 47, 92), (231, 217, 194),
    (24, 76, 245), (151, 161, 2), (88, 246, 53), (215, 3, 104), (56, 88, 155), (183, 173, 206), (120, 31, 12),
    (247, 116, 63), (4, 201, 114), (131, 60, 165), (68, 145, 216),
)  # fmt: skip
"""8-bit sRGB: colors that no training color is near."""

SETS = {"train": TRAIN, "test": TEST}


def recolor(
    A: NDArray[np.floating], B: NDArray[np.floating], colors_srgb: NDArray[np.floating] | Color
) -> NDArray[np.float32]:
    """The frame in uniform paint, linear light, not clipped: ``A * color + B`` (the design's affine light transport).

    Args:
        A, B: (H, W, 3) linear light maps.
        colors_srgb: (3,) or (N, 3) sRGB in 0 to 255.

    Returns:
        (H, W, 3), or (N, H, W, 3) for N colors; float32 linear.
    """
    albedo = srgb_to_linear(np.asarray(colors_srgb, np.float32) / 255)
    gain, rest = np.asarray(A, np.float32), np.asarray(B, np.float32)
    return gain * albedo[..., None, None, :] + rest


def find_colors(text: str) -> tuple[Color, ...]:
    """``train``, ``test``, or comma-separated sRGB colors like ``ff8800,8c8c8c``; each once."""
    if text in SETS:
        return SETS[text]
    colors = []
    for part in text.split(","):
        if not re.fullmatch("#?[0-9a-fA-F]{6}", part.strip()):
            raise RaucaError(f"colors {part.strip()!r}: give train, test, or sRGB colors like ff8800,8c8c8c")
        red, green, blue = bytes.fromhex(part.strip().removeprefix("#"))
        colors.append((red, green, blue))
    return tuple(dict.fromkeys(colors))


def hex_name(color: Color) -> str:
    """``(255, 136, 0)`` as ``ff8800``."""
    return bytes(color).hex()


def check_color(seed: int, share: float, frame_id: str) -> Color | None:
    """The test color in which a frame is rendered for real, or None: a ``share`` of all frames is.

    Depends on the plan's seed and the frame's name alone, so shards and reruns agree.
    """
    rng = named_rng(seed, "recolor check", frame_id)
    return TEST[rng.integers(len(TEST))] if rng.random() < share else None
